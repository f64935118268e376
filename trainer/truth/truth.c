// Reads configurations, runs ODE simulators, and checks the laws, for all simulators alike.
#include "truth/truth.h"

#include <limits.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

static const pm_truth_simulator simulators[] = {
    {"pendulum_chain", pm_pendulum_chain_read, NULL},
    {"driven_link", pm_driven_link_read, NULL},
    {"gas_containers", pm_gas_containers_read, NULL},
};
enum { NSIMULATOR = sizeof simulators / sizeof *simulators, MOST_SIMULATORS = 16 };

// The tolerances are as small as double precision allows, because the close passes of the pendulum
// amplify errors by a factor of ten thousand and more. The check takes other steps and has about
// twice the error.
static const double solve_tolerance = 1e-15, check_tolerance = 2e-15;
// The components of the states are of order 1 to 1e-2.
static const double absolute_per_relative = 0.1;

static const char *const families[] = {"adams", "bdf", NULL}; // indexed by pm_ode_family

static pm_status read_root(pm_truth *truth, pm_yaml root, const pm_truth_simulator *more) {
    pm_yaml system;
    int seed = 0, family = PM_ODE_ADAMS, id = 0, count = NSIMULATOR;
    const char *names[MOST_SIMULATORS + 1] = {NULL};
    for (int i = 0; i < NSIMULATOR; ++i) {
        names[i] = simulators[i].name;
    }
    for (int i = 0; more != NULL && more[i].name != NULL && count < MOST_SIMULATORS; ++i) {
        names[count++] = more[i].name;
    }
    const pm_yaml_key keys[] = {
        {PM_YAML_CHOICE("solver", &family, families)},
        {PM_YAML_INT("seed", &seed, 0, INT_MAX), .required = true},
        {PM_YAML_INT("trajectories", &truth->ntrajectory, 1, 1000000), .required = true},
        {PM_YAML_INT("states", &truth->ntime, 2, 1000000), .required = true},
        {PM_YAML_DOUBLE("dt", &truth->dt, 1e-9, 1e9), .required = true},
        {PM_YAML_CHOICE("simulator", &id, names), .required = true},
        {PM_YAML_VALUE("system", &system), .required = true},
        {0}};
    PM_TRY(pm_yaml_read(root, &truth->arena, keys));
    truth->family = (pm_ode_family)family;
    truth->seed = (uint64_t)seed;
    truth->simulator = id < NSIMULATOR ? &simulators[id] : &more[id - NSIMULATOR];
    return truth->simulator->read(system, &truth->arena, &truth->model);
}

pm_status pm_truth_load(pm_truth **result, const char *path, const pm_truth_simulator *more) {
    pm_yaml_document *document = NULL;
    pm_yaml root;
    pm_status status = PM_OK;
    pm_truth *truth = NULL;
    PM_TRY(PM_NEW(truth, path));
    PM_TRY_DONE(pm_yaml_open(&document, path, &root));
    truth->model.path = path;
    PM_TRY_DONE(read_root(truth, root, more));
    truth->model.path = NULL; // the caller owns it
    *result = truth;
    truth = NULL;
done:
    pm_yaml_close(document);
    pm_truth_free(truth);
    return status;
}

void pm_truth_free(pm_truth *truth) {
    PM_DELETE(truth);
}

static pm_status solve(const pm_truth *truth, double tolerance, double *z) {
    const pm_ode_method method = {truth->family, tolerance, absolute_per_relative * tolerance};
    return pm_ode_solve(&truth->model.ode, method, truth->ntime, truth->dt, z);
}

pm_status pm_truth_run(const pm_truth *truth, int trajectory, double *z, double *check) {
    const pm_truth_model *model = &truth->model;
    pm_rng rng;
    pm_rng_init(&rng, truth->seed, (uint64_t)trajectory);
    model->draw(model->ode.data, &rng, z);
    memcpy(check, z, (size_t)model->ode.nz * sizeof *z);
    pm_status status = solve(truth, solve_tolerance, z);
    if (status == PM_OK) {
        status = solve(truth, check_tolerance, check);
    }
    return status == PM_OK ? PM_OK : pm_fail(status, "trajectory %d: %s", trajectory, pm_error());
}

void pm_truth_report_init(pm_truth_report *report) {
    memset(report, 0, sizeof *report);
    report->entropy_step = INFINITY;
}

double pm_truth_difference(const pm_truth *truth, const double *z, const double *check) {
    const size_t nz = (size_t)truth->model.ode.nz;
    double worst = 0;
    for (size_t j = 0; j < nz; ++j) {
        double largest = 0, square = 0; // of the column
        for (int i = 0; i < truth->ntime; ++i) {
            const double value = z[(size_t)i * nz + j];
            largest = fmax(largest, fabs(value - check[(size_t)i * nz + j]));
            square += value * value;
        }
        worst = fmax(worst, square > 0 ? largest / sqrt(square / truth->ntime) : largest);
    }
    return worst;
}

void pm_truth_report_add(pm_truth_report *report, const pm_truth *truth, const double *z) {
    const pm_truth_model *model = &truth->model;
    const void *data = model->ode.data;
    double start[PM_TRUTH_MAX_CONSERVED], value[PM_TRUTH_MAX_CONSERVED];
    const double first = model->entropy == NULL ? 0 : model->entropy(data, z);
    double before = first;
    ++report->ntrajectory;
    model->conserve(data, z, start);
    for (int i = 0; i < truth->ntime; ++i) {
        const double *now = z + (size_t)i * (size_t)model->ode.nz;
        model->conserve(data, now, value);
        for (int k = 0; k < model->nconserved; ++k) {
            report->drift[k] = fmax(report->drift[k], fabs(value[k] - start[k]));
            report->magnitude[k] = fmax(report->magnitude[k], fabs(value[k]));
        }
        if (i > 0 && model->entropy != NULL) {
            const double entropy = model->entropy(data, now);
            report->entropy_step = fmin(report->entropy_step, entropy - before);
            before = entropy;
        }
    }
    report->entropy_rise += (before - first - report->entropy_rise) / report->ntrajectory;
}
