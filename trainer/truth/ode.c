// Opens a CVODE solver, lets it write sample after sample, and closes it. Sparse Jacobians: colours
// the columns of the pattern greedily, and takes one difference for each colour.
#include "truth/ode.h"

#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunlinsol/sunlinsol_klu.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunmatrix/sunmatrix_sparse.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#include "base/arena.h"

#define MAX_STEPS_PER_SAMPLE 1000000L
#define AMD 0 // KLU's ordering for patterns that are nearly symmetric
// Relative to dt. Without a smallest step CVODE reduces its step at a singularity to 0, and then
// passes the singularity unnoticed.
#define MIN_STEP 1e-13

// --- sparse Jacobians ---

struct pm_ode_jacobian {
    const pm_ode *ode;
    pm_arena arena;
    int ncolour;
    int *first;  // [ncolour + 1] where the columns of each colour begin in `column`
    int *column; // [nz] columns, ordered by colour
};

pm_ode_jacobian *pm_ode_jacobian_new(const pm_ode *ode) {
    const pm_ode_pattern *pattern = ode->pattern;
    const size_t nz = (size_t)ode->nz;
    const int n = ode->nz, nentry = pattern->start[n];
    pm_ode_jacobian *jacobian = calloc(1, sizeof *jacobian);
    if (jacobian == NULL) {
        return NULL;
    }
    pm_arena *arena = &jacobian->arena;
    int *colour = pm_arena_array(arena, nz, sizeof *colour);
    int *taken = pm_arena_array(arena, nz + 1, sizeof *taken);
    // The pattern row by row: the columns of row i are column[start[i]] to column[start[i + 1] -
    // 1].
    int *start = pm_arena_array(arena, nz + 2, sizeof *start);
    int *column = pm_arena_array(arena, (size_t)nentry + 1, sizeof *column);
    jacobian->ode = ode;
    jacobian->first = pm_arena_array(arena, nz + 2, sizeof *jacobian->first);
    jacobian->column = pm_arena_array(arena, nz, sizeof *jacobian->column);
    if (pm_arena_status(arena, "the colours of a Jacobian") != PM_OK) {
        pm_ode_jacobian_free(jacobian);
        return NULL;
    }
    int *end = start + 1; // ends as the array of starts, one place further
    for (int i = 0; i < nentry; ++i) {
        ++end[pattern->row[i] + 1];
    }
    for (int i = 0; i < n; ++i) {
        end[i + 1] += end[i];
    }
    for (int j = 0; j < n; ++j) {
        for (int i = pattern->start[j]; i < pattern->start[j + 1]; ++i) {
            column[end[pattern->row[i]]++] = j;
        }
    }
    // Each column has the smallest colour that no column before it has with which it shares a row.
    memset(taken, -1, (nz + 1) * sizeof *taken);
    for (int j = 0; j < n; ++j) {
        for (int i = pattern->start[j]; i < pattern->start[j + 1]; ++i) {
            const int row = pattern->row[i];
            for (int k = start[row]; k < start[row + 1] && column[k] < j; ++k) {
                taken[colour[column[k]]] = j;
            }
        }
        while (taken[colour[j]] == j) {
            ++colour[j];
        }
        jacobian->ncolour = colour[j] < jacobian->ncolour ? jacobian->ncolour : colour[j] + 1;
    }
    // The columns in the order of their colours.
    end = jacobian->first + 1;
    for (int j = 0; j < n; ++j) {
        ++end[colour[j] + 1];
    }
    for (int c = 0; c < jacobian->ncolour; ++c) {
        end[c + 1] += end[c];
    }
    for (int j = 0; j < n; ++j) {
        jacobian->column[end[colour[j]]++] = j;
    }
    return jacobian;
}

void pm_ode_jacobian_free(pm_ode_jacobian *jacobian) {
    PM_DELETE(jacobian);
}

bool pm_ode_jacobian_fill(const pm_ode_jacobian *jacobian, const pm_ode_difference *d,
                          double *value) {
    const pm_ode *ode = jacobian->ode;
    const pm_ode_pattern *pattern = ode->pattern;
    const int nz = ode->nz;
    double square = 0;
    bool finite = true;
    for (int i = 0; i < nz; ++i) {
        square += d->zdot[i] * d->weight[i] * (d->zdot[i] * d->weight[i]);
    }
    // The smallest difference for a component of weight 1, as CVODE's cvLsDenseDQJac has it.
    const double norm = sqrt(square / nz);
    const double smallest = norm > 0 ? 1000 * fabs(d->h) * DBL_EPSILON * nz * norm : 1;
    memcpy(d->moved, d->z, (size_t)nz * sizeof *d->moved);
    for (int c = 0; c < jacobian->ncolour; ++c) {
        const int begin = jacobian->first[c], end = jacobian->first[c + 1];
        for (int k = begin; k < end; ++k) {
            const int j = jacobian->column[k];
            d->moved[j] += fmax(sqrt(DBL_EPSILON) * fabs(d->z[j]), smallest / d->weight[j]);
        }
        ode->rate(ode->data, d->moved, d->rate);
        for (int k = begin; k < end; ++k) {
            const int j = jacobian->column[k];
            const double difference = d->moved[j] - d->z[j];
            for (int i = pattern->start[j]; i < pattern->start[j + 1]; ++i) {
                value[i] = (d->rate[pattern->row[i]] - d->zdot[pattern->row[i]]) / difference;
                finite = finite && isfinite(value[i]);
            }
            d->moved[j] = d->z[j];
        }
    }
    return finite;
}

// --- CVODE ---

typedef struct cvode_solver {
    const pm_ode *ode;
    SUNContext context;
    N_Vector z;
    void *cvode;
    SUNMatrix jacobian;             // bdf
    SUNLinearSolver linear;         // bdf
    N_Vector weight;                // bdf with a pattern: one over the tolerated errors
    pm_ode_jacobian *differences;   // bdf with a pattern
    SUNNonlinearSolver fixed_point; // adams
} cvode_solver;

// The right-hand side for CVODE. A rate that is not finite makes CVODE try a smaller step.
static int evaluate(realtype t, N_Vector z, N_Vector zdot, void *data) {
    (void)t;
    const pm_ode *ode = ((const cvode_solver *)data)->ode;
    double *rate = N_VGetArrayPointer(zdot);
    ode->rate(ode->data, N_VGetArrayPointer(z), rate);
    for (int i = 0; i < ode->nz; ++i) {
        if (!isfinite(rate[i])) {
            return 1;
        }
    }
    return 0;
}

// The sparse Jacobian for CVODE. One that is not finite makes CVODE try a smaller step.
static int differentiate(realtype t, N_Vector z, N_Vector zdot, SUNMatrix jacobian, void *data,
                         N_Vector work1, N_Vector work2, N_Vector work3) {
    (void)t, (void)work3;
    const cvode_solver *s = data;
    const pm_ode_pattern *pattern = s->ode->pattern;
    double h = 0;
    CVodeGetCurrentStep(s->cvode, &h);
    CVodeGetErrWeights(s->cvode, s->weight);
    const pm_ode_difference difference = {.h = h,
                                          .z = N_VGetArrayPointer(z),
                                          .zdot = N_VGetArrayPointer(zdot),
                                          .weight = N_VGetArrayPointer(s->weight),
                                          .moved = N_VGetArrayPointer(work1),
                                          .rate = N_VGetArrayPointer(work2)};
    for (int j = 0; j <= s->ode->nz; ++j) {
        SUNSparseMatrix_IndexPointers(jacobian)[j] = pattern->start[j];
    }
    for (int i = 0; i < pattern->start[s->ode->nz]; ++i) {
        SUNSparseMatrix_IndexValues(jacobian)[i] = pattern->row[i];
    }
    return pm_ode_jacobian_fill(s->differences, &difference, SUNSparseMatrix_Data(jacobian)) ? 0
                                                                                             : 1;
}

// Keeps CVODE from printing to standard error, since its return value says enough.
static void stay_silent(int code, const char *module, const char *function, char *text,
                        void *data) {
    (void)code, (void)module, (void)function, (void)text, (void)data;
}

// Attaches the nonlinear solver that the family of methods needs. Returns the code of CVODE.
static int attach_iteration(cvode_solver *s, pm_ode_family family) {
    const int nz = s->ode->nz;
    const pm_ode_pattern *pattern = s->ode->pattern;
    if (family == PM_ODE_ADAMS) {
        s->fixed_point = SUNNonlinSol_FixedPoint(s->z, 0, s->context);
        return s->fixed_point == NULL ? CV_MEM_FAIL
                                      : CVodeSetNonlinearSolver(s->cvode, s->fixed_point);
    }
    if (pattern == NULL) {
        s->jacobian = SUNDenseMatrix(nz, nz, s->context);
        s->linear = s->jacobian == NULL ? NULL : SUNLinSol_Dense(s->z, s->jacobian, s->context);
        return s->linear == NULL ? CV_MEM_FAIL
                                 : CVodeSetLinearSolver(s->cvode, s->linear, s->jacobian);
    }
    s->weight = N_VClone(s->z);
    s->differences = pm_ode_jacobian_new(s->ode);
    s->jacobian = SUNSparseMatrix(nz, nz, pattern->start[nz], CSC_MAT, s->context);
    s->linear = s->jacobian == NULL ? NULL : SUNLinSol_KLU(s->z, s->jacobian, s->context);
    if (s->weight == NULL || s->differences == NULL || s->linear == NULL) {
        return CV_MEM_FAIL;
    }
    SUNLinSol_KLUSetOrdering(s->linear, AMD);
    const int code = CVodeSetLinearSolver(s->cvode, s->linear, s->jacobian);
    return code == CV_SUCCESS ? CVodeSetJacFn(s->cvode, differentiate) : code;
}

// Opens a solver at the initial state z [nz], which remains the solver's storage until another one
// is set.
static pm_status solver_open(cvode_solver *s, const pm_ode *ode, pm_ode_method method, double dt,
                             double *z) {
    memset(s, 0, sizeof *s);
    s->ode = ode;
    if (SUNContext_Create(NULL, &s->context) != 0) {
        return pm_fail(PM_ENOMEM, "SUNDIALS: out of memory");
    }
    s->z = N_VMake_Serial(ode->nz, z, s->context);
    s->cvode = CVodeCreate(method.family == PM_ODE_ADAMS ? CV_ADAMS : CV_BDF, s->context);
    if (s->z == NULL || s->cvode == NULL) {
        return pm_fail(PM_ENOMEM, "CVODE: out of memory");
    }
    CVodeSetErrHandlerFn(s->cvode, stay_silent, NULL);
    if (CVodeInit(s->cvode, evaluate, 0, s->z) != CV_SUCCESS ||
        CVodeSStolerances(s->cvode, method.relative, method.absolute) != CV_SUCCESS ||
        CVodeSetUserData(s->cvode, s) != CV_SUCCESS ||
        CVodeSetMinStep(s->cvode, MIN_STEP * dt) != CV_SUCCESS ||
        CVodeSetMaxNumSteps(s->cvode, MAX_STEPS_PER_SAMPLE) != CV_SUCCESS) {
        return pm_fail(PM_ENUMERIC, "CVODE refused its settings");
    }
    return attach_iteration(s, method.family) == CV_SUCCESS
               ? PM_OK
               : pm_fail(PM_ENOMEM, "CVODE: out of memory");
}

pm_status pm_ode_solve(const pm_ode *ode, pm_ode_method method, int ntime, double dt, double *z) {
    cvode_solver s;
    pm_status status = PM_OK;
    PM_TRY_DONE(solver_open(&s, ode, method, dt, z));
    for (int i = 1; i < ntime; ++i) {
        double reached = 0;
        N_VSetArrayPointer(z + (size_t)i * (size_t)ode->nz, s.z);
        const int code = CVode(s.cvode, i * dt, s.z, &reached, CV_NORMAL);
        if (code < 0) {
            char *name = CVodeGetReturnFlagName(code);
            status = pm_fail(PM_ENUMERIC, "CVODE failed between t = %g and %g s: %s", (i - 1) * dt,
                             i * dt, name == NULL ? "" : name);
            free(name);
            goto done;
        }
    }
done:
    CVodeFree(&s.cvode);
    SUNNonlinSolFree(s.fixed_point);
    SUNLinSolFree(s.linear);
    SUNMatDestroy(s.jacobian);
    N_VDestroy(s.weight);
    N_VDestroy(s.z);
    pm_ode_jacobian_free(s.differences);
    SUNContext_Free(&s.context);
    return status;
}
