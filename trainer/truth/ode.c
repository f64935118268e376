// Opens a CVODE solver, lets it write sample after sample, and closes it.
#include "truth/ode.h"

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cvode/cvode.h>
#include <nvector/nvector_serial.h>
#include <sundials/sundials_context.h>
#include <sunlinsol/sunlinsol_dense.h>
#include <sunmatrix/sunmatrix_dense.h>
#include <sunnonlinsol/sunnonlinsol_fixedpoint.h>

#define MAX_STEPS_PER_SAMPLE 1000000L
// Relative to dt. Without a smallest step CVODE reduces its step at a singularity to 0, and then
// passes the singularity unnoticed.
#define MIN_STEP 1e-13

typedef struct cvode_solver {
    SUNContext context;
    N_Vector z;
    void *cvode;
    SUNMatrix jacobian;             // bdf
    SUNLinearSolver linear;         // bdf
    SUNNonlinearSolver fixed_point; // adams
} cvode_solver;

// The right-hand side for CVODE. A rate that is not finite makes CVODE try a smaller step.
static int evaluate(realtype t, N_Vector z, N_Vector zdot, void *data) {
    (void)t;
    const pm_ode *ode = data;
    double *rate = N_VGetArrayPointer(zdot);
    ode->rate(ode->data, N_VGetArrayPointer(z), rate);
    for (int i = 0; i < ode->nz; ++i) {
        if (!isfinite(rate[i])) {
            return 1;
        }
    }
    return 0;
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
    N_VDestroy(s->z);
    SUNContext_Free(&s->context);
}

// Attaches the nonlinear solver that the family of methods needs.
static pm_status attach_iteration(cvode_solver *s, pm_ode_family family, int nz) {
    int code;
    if (family == PM_ODE_ADAMS) {
        s->fixed_point = SUNNonlinSol_FixedPoint(s->z, 0, s->context);
        code = s->fixed_point == NULL ? 0 : CVodeSetNonlinearSolver(s->cvode, s->fixed_point);
    } else {
        s->jacobian = SUNDenseMatrix(nz, nz, s->context);
        s->linear = s->jacobian == NULL ? NULL : SUNLinSol_Dense(s->z, s->jacobian, s->context);
        code = s->linear == NULL ? 0 : CVodeSetLinearSolver(s->cvode, s->linear, s->jacobian);
    }
    const bool made = s->fixed_point != NULL || s->linear != NULL;
    return made && code == CV_SUCCESS ? PM_OK : pm_fail(PM_ENOMEM, "CVODE: out of memory");
}

// Opens a solver at the initial state z [nz], which remains the solver's storage until another one
// is set.
static pm_status solver_open(cvode_solver *s, const pm_ode *ode, pm_ode_method method, double dt,
                             double *z) {
    memset(s, 0, sizeof *s);
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
        CVodeSetUserData(s->cvode, (void *)(uintptr_t)ode) != CV_SUCCESS ||
        CVodeSetMinStep(s->cvode, MIN_STEP * dt) != CV_SUCCESS ||
        CVodeSetMaxNumSteps(s->cvode, MAX_STEPS_PER_SAMPLE) != CV_SUCCESS) {
        return pm_fail(PM_ENUMERIC, "CVODE refused its settings");
    }
    return attach_iteration(s, method.family, ode->nz);
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
