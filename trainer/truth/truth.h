// Ground truth. A configuration names a simulator, its parameters and the number of trajectories to
// draw. A simulator is one file with a function that reads its part of the configuration, and one
// line in a table: that of truth.c, or one that the caller adds. Simulators share no code with the
// models that are trained on their output, so that a mistake in a model cannot hide.
#ifndef PM_TRAINER_TRUTH_TRUTH_H
#define PM_TRAINER_TRUTH_TRUTH_H

#include <signal.h>
#include <stdint.h>

#include "base/arena.h"
#include "base/rng.h"
#include "store/yaml.h"
#include "truth/ode.h"

#define PM_TRUTH_MAX_CONSERVED 4

// The model that a simulator makes of its configuration. Everything lives in the configuration's
// arena. A simulator that writes its own files uses ode.data, title, units and parameters alone.
typedef struct pm_truth_model {
    const char *path; // of the truth file, known before the simulator reads its block
    pm_ode ode;
    const char *title;
    int ncolumn; // the first ncolumn components of the state become columns of the dataset
    const char *const *column; // [ncolumn]
    const char *units;         // of columns or variables, separated by ';'
    const char *parameters;    // as text, for the dataset's notes
    // Draws an initial state z [nz].
    void (*draw)(const void *data, pm_rng *rng, double *z);
    int nconserved;               // quantities that the exact solution conserves
    const char *const *conserved; // [nconserved] their names
    // Computes their values at a state: value [nconserved].
    void (*conserve)(const void *data, const double *z, double *value);
    // The total entropy at a state, J/K, which never falls; NULL: there is none.
    double (*entropy)(const void *data, const double *z);
} pm_truth_model;

struct pm_truth;
typedef struct pm_truth_simulator {
    const char *name;
    // Reads the configuration's `system:` block. PM_ECONFIG, PM_ENOMEM.
    pm_status (*read)(pm_yaml block, pm_arena *arena, pm_truth_model *model);
    // Simulates `count` trajectories from number `first` on, prints how good they are, and writes
    // them to `path`. `command` is the command line, for the notes. PM_EINTERRUPTED if *stop
    // becomes non-zero, PM_ECONFIG, PM_ENUMERIC, PM_EFILE, PM_ENOMEM. NULL: the model is an ODE.
    pm_status (*write)(const struct pm_truth *truth, int first, int count, const char *command,
                       const char *path, const volatile sig_atomic_t *stop);
} pm_truth_simulator;

typedef struct pm_truth {
    pm_arena arena;
    uint64_t seed;
    int ntrajectory, ntime;
    double dt; // s
    pm_ode_family family;
    const pm_truth_simulator *simulator;
    pm_truth_model model;
} pm_truth;

// Reads the truth file (TRUTH.md) at `path`. Its simulator is one of this folder or of the table
// `more`, whose last row has no name; NULL: there are no more. PM_EFILE, PM_ECONFIG, PM_ENOMEM. The
// caller frees the result with pm_truth_free.
pm_status pm_truth_load(pm_truth **truth, const char *path, const pm_truth_simulator *more);
void pm_truth_free(pm_truth *truth); // NULL is allowed

// Solves the ODE for trajectory number `trajectory` and writes the solution to z [ntime][nz].
// Solves it again with twice the tolerance and writes this solution to check [ntime][nz]; the
// difference shows how well both have converged. The initial state depends on the seed and the
// number of the trajectory alone. PM_ENUMERIC, PM_ENOMEM.
pm_status pm_truth_run(const pm_truth *truth, int trajectory, double *z, double *check);

// Returns the largest |z - check| of any component, relative to the root mean square of the
// component.
double pm_truth_difference(const pm_truth *truth, const double *z, const double *check);

// Statistics of conserved quantities and of entropy over all trajectories.
typedef struct pm_truth_report {
    int ntrajectory;
    double drift[PM_TRUTH_MAX_CONSERVED];     // largest |change| since the start of a trajectory
    double magnitude[PM_TRUTH_MAX_CONSERVED]; // largest |value|
    double entropy_step;                      // J/K, smallest change from one time to the next
    double entropy_rise;                      // J/K, mean change over a whole trajectory
} pm_truth_report;

void pm_truth_report_init(pm_truth_report *report);
// Adds the trajectory z [ntime][nz].
void pm_truth_report_add(pm_truth_report *report, const pm_truth *truth, const double *z);

// --- simulators ---

// A chain of thermoelastic pendula (chain.h).
pm_status pm_pendulum_chain_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);
// One thermoelastic link with a driven pivot, a force on its mass and a heat bath (chain.c).
pm_status pm_driven_link_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);
// Two gases that exchange heat and volume through a moving wall (gas_containers.c).
pm_status pm_gas_containers_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);

#endif
