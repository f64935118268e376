// Ground truth: a configuration names a simulator, its parameters and how many trajectories to
// draw. A simulator is one file with a function that reads its part of the configuration, and one
// line in the table of truth.c. Shares no code with the models that are trained on its output.
#ifndef PM_TRAINER_TRUTH_TRUTH_H
#define PM_TRAINER_TRUTH_TRUTH_H

#include <stdint.h>

#include "base/arena.h"
#include "base/rng.h"
#include "store/field.h"
#include "store/yaml.h"
#include "truth/ode.h"

#define PM_TRUTH_MAX_CONSERVED 4
// Bodies with fields on a mesh, in place of an ODE. `data` is the model's.
typedef struct pm_truth_body {
    int nbody;
    const char *const *name;        // [nbody]; NULL: one without a name
    const char *const *placement;   // [nbody] of its frame in the world, as text; NULL: the world's
    int nnode, nelement, nvariable; // of each body
    const char *variable;           // of each node, separated by blanks
    // Fills in the mesh of each body's field, in its own frame.
    void (*describe)(const void *data, int body, pm_field *field);
    // Trajectory `trajectory` of this seed, into row `row` of the fields [nbody], each in its
    // body's frame. PM_ECONFIG (there is no such trajectory), PM_ENUMERIC, PM_ENOMEM.
    pm_status (*run)(const void *data, uint64_t seed, int trajectory, pm_field *const *field,
                     int row);
} pm_truth_body;

// What a simulator makes of its configuration. Everything lives in the configuration's arena.
typedef struct pm_truth_model {
    pm_ode ode;
    const pm_truth_body *body; // NULL: an ODE. Otherwise of the ODE only `data` has a meaning, and
    // of what follows only title, units and parameters.
    const char *title;
    int ncolumn; // of the dataset: the first components of the state; others stay inside
    const char *const *column;                              // [ncolumn]
    const char *units;                                      // of columns or variables, by ';'
    const char *parameters;                                 // as text, for the dataset's notes
    void (*draw)(const void *data, pm_rng *rng, double *z); // an initial state [nz]
    // Quantities that the exact solution keeps (at most PM_TRUTH_MAX_CONSERVED): their names, and
    // their values at a state.
    int nconserved;
    const char *const *conserved;
    void (*conserve)(const void *data, const double *z, double *value);
    double (*entropy)(const void *data, const double *z); // J/K, never falls; NULL: none
} pm_truth_model;

typedef struct pm_truth_simulator {
    const char *name;
    // Reads the configuration's `system:` block. PM_ECONFIG, PM_ENOMEM.
    pm_status (*read)(pm_yaml block, pm_arena *arena, pm_truth_model *model);
} pm_truth_simulator;

typedef struct pm_truth {
    pm_arena arena;
    uint64_t seed;
    int ntrajectory, ntime;
    double dt; // s
    pm_ode_family family;
    pm_truth_model model;
} pm_truth;

// Reads a configuration. PM_EFILE, PM_ECONFIG, PM_ENOMEM. The caller frees.
pm_status pm_truth_load(pm_truth **truth, const char *path);
void pm_truth_free(pm_truth *truth); // NULL is allowed

// For an ODE: trajectory `trajectory` [ntime][nz], from its own stream of random numbers, and in
// `check` the same at twice the tolerance, to tell how far it is converged. PM_ENUMERIC, PM_ENOMEM.
pm_status pm_truth_run(const pm_truth *truth, int trajectory, double *z, double *check);

// Largest |z - check| of any column over that column's root mean square.
double pm_truth_difference(const pm_truth *truth, const double *z, const double *check);

// How well the laws are kept, over all trajectories added.
typedef struct pm_truth_report {
    int ntrajectory;
    double drift[PM_TRUTH_MAX_CONSERVED];     // largest |change| since a trajectory's start
    double magnitude[PM_TRUTH_MAX_CONSERVED]; // largest |value|
    double entropy_step;                      // J/K, smallest change from one state to the next
    double entropy_rise;                      // J/K, mean over a whole trajectory
} pm_truth_report;

void pm_truth_report_init(pm_truth_report *report);
void pm_truth_report_add(pm_truth_report *report, const pm_truth *truth, const double *z);

// --- simulators ---

// A chain of thermoelastic pendula (chain.h).
pm_status pm_pendulum_chain_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);
// One thermoelastic link whose pivot is driven, with a force on its mass and a bath beside it.
pm_status pm_driven_link_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);
// A clamped beam of viscoelastic rubber, pressed from its sides (beam_solve.h).
pm_status pm_beam_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);
// Two gases that exchange heat and volume through a moving wall.
pm_status pm_gas_containers_read(pm_yaml block, pm_arena *arena, pm_truth_model *model);

#endif
