// A tally sums up one step of some subsystems and ports for the ledger (ledger.h): total energy and
// entropy, booked fluxes, and the worst residuals. Tallies of several processes are merged into
// that of the scene. The result has the same bits however subsystems and ports are divided among
// tallies, since the sums are reproducible (base/reproducible_sum.h) and everything else is a
// largest value.
//
// The residual of a port with the fluxes into ends a and b is
//     energy    |energy_a + energy_b| / gross      entropy    (entropy_a + entropy_b) / gross
// where gross = max(gross_a, gross_b). A bulk term has one end. Which residuals count depends on
// the largest gross flux of the scene, which no process knows: a smaller one is rounding itself. A
// tally therefore keeps the worst residuals of PM_TALLY_CLASSES classes of gross fluxes. A class
// holds the fluxes between two powers of 2^8, and those of the largest classes count: a flux counts
// if it is at least 2^-40 = 9e-13 of the largest, and does not count if it is less than 2^-48 =
// 4e-15 of it.
#ifndef PM_SIM_TALLY_H
#define PM_SIM_TALLY_H

#include "base/reproducible_sum.h"
#include "scene/recording.h"
#include "scene/system.h"
#include "sim/lanes.h"

#define PM_TALLY_CLASSES 6
#define PM_TALLY_HARD 0 // components that keep both laws by construction
#define PM_TALLY_SOFT 1 // all others

typedef enum pm_tally_law { PM_TALLY_ENERGY, PM_TALLY_ENTROPY, PM_TALLY_LAWS } pm_tally_law;

// The worst residual of some components. Of equal residuals it is that of the first component.
typedef struct pm_tally_worst {
    double residual; // its magnitude; 0: there is none. Entropies count only if they fall.
    double place;    // position of a port in the scene, or the number of ports plus that of a
                     // subsystem
} pm_tally_worst;

// All members are numbers that a message can carry. A struct of zeros is the empty tally.
typedef struct pm_tally {
    pm_reproducible_sum energy, entropy; // J, J/K
    pm_reproducible_sum magnitude;       // J, of the magnitudes of energies
    pm_reproducible_sum booked, gross;   // W, all energy fluxes, and all gross ones
    double top[PM_TALLY_LAWS];           // number of the largest class; 0: there is no flux
    // Element k: of the components in the k + 1 largest classes.
    pm_tally_worst worst[PM_TALLY_LAWS][2][PM_TALLY_CLASSES];
    double evaluated, skipped; // graphs so far
    double nout_of_range;      // subsystems that have ended steps outside their training ranges
    double worst_steps,
        worst_subsystem; // the largest number of such steps, and the subsystem's position
} pm_tally;

#define PM_TALLY_NUMBERS ((int)(sizeof(pm_tally) / sizeof(double)))

// Adds the energies E (J) and entropies S (J/K) of subsystems, both [count].
void pm_tally_add_content(pm_tally *tally, int count, const double *E, const double *S);
// Adds the fluxes into one end (`b` NULL) or both ends of `count` components of this form.
// Component i is at the place first + id[i], or first + i if `id` is NULL. Places ascend.
void pm_tally_add_fluxes(pm_tally *tally, int form, int count, int first, const int *id,
                         const pm_lane_flux *a, const pm_lane_flux *b);
// Adds the counts of the subsystem at position `id`.
void pm_tally_add_counts(pm_tally *tally, int id, long evaluated, long skipped, long outside);

// Add what a sample has of all subsystems, of all ports, or of the ports port [count].
void pm_tally_add_subsystems(pm_tally *tally, const pm_system *system, const pm_sample *sample);
void pm_tally_add_ports(pm_tally *tally, const pm_system *system, const pm_sample *sample,
                        int count, const int *port);

// Adds another tally.
void pm_tally_merge(pm_tally *tally, const pm_tally *other);

// Returns the worst residual of the components of a form that count, over the whole tally.
pm_tally_worst pm_tally_worst_of(const pm_tally *tally, pm_tally_law law, int form);

// Return the form of a port or of a subsystem.
int pm_tally_form_of_port(const pm_system *system, int port);
int pm_tally_form_of_subsystem(const pm_system *system, int id);

#endif
