// A sample holds the state and the fluxes of one step of a run. Two tables list what is known of
// each subsystem and of each end of a port after a step. Everything that passes these numbers on
// goes through the tables: books, samples, reports (the message report_t) and recordings. The
// tables are made from report_t. A new number of a subsystem is an array [npart] of report_t, and
// the engine (sim/) sets the number of the same name in the books.
#ifndef PM_SCENE_SAMPLE_H
#define PM_SCENE_SAMPLE_H

#include "scene/report_numbers.h"
#include "scene/scene.h"

// The tables, with the name and the unit of the series in a recording (NULL: it has none).
// PM_SUBSYSTEM_NUMBERS lists the numbers of a subsystem after a step:
//     NUMBER(type, name, series, unit)    a double or a long, a member of pm_books
//     BULK(member, name, series, unit)    a member of pm_books.bulk
// PM_END_NUMBERS lists those of an end of a port. A recording adds "_a" or "_b" for the end:
//     END(member, name, series, unit)     a member of pm_flux
// Columns of pm_sample and arrays of report_t are called `name`.

// The fluxes through one end of a port, positive into the subsystem. Each is a mean over one step
// with the weights of the integrator:
//     energy   of sum_j e_j ydot_j       energy_gross   of sum_j |e_j ydot_j|
//     entropy  of sum_j eta_j ydot_j     entropy_gross  of sum_j |eta_j ydot_j|
// The gross fluxes are the scale of rounding.
typedef struct pm_flux {
    double energy;        // W
    double entropy;       // W/K
    double energy_gross;  // W
    double entropy_gross; // W/K
} pm_flux;

#define PM_NUMBER_MEMBER(type, name, series, unit) type name;
#define PM_NUMBER_COLUMN(type, name, series, unit) type *name;
#define PM_BULK_COLUMN(member, name, series, unit) double *name;
#define PM_NO_MEMBER(member, name, series, unit)

// The books of a subsystem: what enters the ledger and the report after a step.
typedef struct pm_books {
    PM_SUBSYSTEM_NUMBERS(PM_NUMBER_MEMBER, PM_NO_MEMBER)
    pm_flux bulk; // of the bulk term L dE + M dS
    int nflux;
    // [nflux] into this subsystem, port by port; then, for each port with a boundary input, into
    // the outside. Borrowed.
    const pm_flux *flux;
} pm_books;

// The state of the whole scene after a step, and what flowed during it.
typedef struct pm_sample {
    long step;   // 0: the initial state, before any step; its fluxes are zero
    double time; // s, pm_scene_time
    double *z;   // [scene->nz]
    PM_SUBSYSTEM_NUMBERS(PM_NUMBER_COLUMN, PM_BULK_COLUMN) // [nsubsystem] each
    pm_flux (*flux)[2];                                    // [nport][end]
    const double *live; // [scene->nlive] borrowed: the values of the live inputs during the step
    // The ledger writes these: the worst residuals of the step, what has left through boundary
    // inputs so far, and the counts above of all subsystems.
    double energy_residual, entropy_residual;
    double outside_energy, outside_entropy; // J, J/K
    long evaluated_in_all, skipped_in_all;
    int nout_of_range;   // subsystems that have ended steps outside the training range
    int worst_subsystem; // the subsystem with the largest number of such steps, and this number
    long worst_steps;
} pm_sample;

// Makes a sample of zeros for a scene. The caller frees it. PM_ENOMEM.
pm_status pm_sample_new(pm_sample **sample, const pm_scene *scene);
void pm_sample_free(pm_sample *sample); // NULL is allowed

// Copies the quantities of the books of the subsystem at position `id` into its places of the
// sample, without the fluxes through ports.
void pm_sample_set_books(pm_sample *sample, int id, const pm_books *books);

#endif
