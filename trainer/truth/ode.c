// Opens a CVODE solver, lets it write sample after sample, and closes it.
#include "truth/ode.h"

#include <math.h>
#include <stdbool.h>
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

#include "truth/ode_jacobian.h"

#define MAX_STEPS_PER_SAMPLE 1000000L
#define AMD 0 // KLU's ordering for patterns that are nearly symmetric
// Relative to dt. Without a smallest step CVODE reduces its step at a singularity to 0, and then
// passes the singularity unnoticed.
#define MIN_STEP 1e-13

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

static void solver_close(cvode_solver *s) {
    CVodeFree(&s->cvode);
    SUNNonlinSolFree(s->fixed_point);
    SUNLinSolFree(s->linear);
    SUNMatDestroy(s->jacobian);
    N_VDestroy(s->weight);
    N_VDestroy(s->z);
    pm_ode_jacobian_free(s->differences);
    SUNContext_Free(&s->context);
}

static int attach_fixed_point(cvode_solver *s) {
    s->fixed_point = SUNNonlinSol_FixedPoint(s->z, 0, s->context);
    return s->fixed_point == NULL ? CV_MEM_FAIL : CVodeSetNonlinearSolver(s->cvode, s->fixed_point);
}

static int attach_dense(cvode_solver *s) {
    s->jacobian = SUNDenseMatrix(s->ode->nz, s->ode->nz, s->context);
    s->linear = s->jacobian == NULL ? NULL : SUNLinSol_Dense(s->z, s->jacobian, s->context);
    return s->linear == NULL ? CV_MEM_FAIL : CVodeSetLinearSolver(s->cvode, s->linear, s->jacobian);
}

static int attach_sparse(cvode_solver *s) {
    const int nz = s->ode->nz, count = s->ode->pattern->start[nz];
    s->weight = N_VClone(s->z);
    s->differences = pm_ode_jacobian_new(s->ode);
    s->jacobian = SUNSparseMatrix(nz, nz, count, CSC_MAT, s->context);
    s->linear = s->jacobian == NULL ? NULL : SUNLinSol_KLU(s->z, s->jacobian, s->context);
    if (s->weight == NULL || s->differences == NULL || s->linear == NULL) {
        return CV_MEM_FAIL;
    }
    SUNLinSol_KLUSetOrdering(s->linear, AMD);
    const int code = CVodeSetLinearSolver(s->cvode, s->linear, s->jacobian);
    return code == CV_SUCCESS ? CVodeSetJacFn(s->cvode, differentiate) : code;
}

// Attaches the nonlinear solver that the family of methods needs.
static pm_status attach_iteration(cvode_solver *s, pm_ode_family family) {
    const int code = family == PM_ODE_ADAMS    ? attach_fixed_point(s)
                     : s->ode->pattern == NULL ? attach_dense(s)
                                               : attach_sparse(s);
    return code == CV_SUCCESS ? PM_OK : pm_fail(PM_ENOMEM, "CVODE: out of memory");
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
    return attach_iteration(s, method.family);
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
    solver_close(&s);
    return status;
}
