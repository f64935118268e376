// A port as seen from one of its two subsystems. It holds the values that this end shows, evaluates
// the port's law (README.md, equation (3), or another law of model/laws) on the values of both
// ends, and sums up the energy and entropy that flow into the subsystem during a step. If the other
// end is a boundary input, it also sums up the flux into the outside.
//
// Life cycle: zero-initialise; open; perhaps share; then in every stage expose, prescribe if there
// is a boundary input, and couple; close. Only the files of subsystem.h use it. Processes exchange
// pm_port_values.
#ifndef PM_SIM_PORT_INSTANCE_H
#define PM_SIM_PORT_INSTANCE_H

#include "base/record.h"
#include "graph/program.h"
#include "scene/boundary_input.h"
#include "scene/integrator.h"
#include "scene/recording.h"
#include "scene/system.h"

// The numbers that one end of a port exposes at a stage. Each array has ny numbers and is borrowed.
typedef struct pm_port_values {
    int ny;
    const double *y;   // exposed components of the state
    const double *e;   // dE/dy
    const double *eta; // dS/dy; all zero without entropy
    // Change of e per unit of rate, with which a discrete integrator predicts e at the end of the
    // step (model/prediction.h); NULL for other integrators.
    const double *response;
    uint64_t known; // of the convergence of a discrete integrator's iteration (iteration.h)
} pm_port_values;

// The four arrays of pm_port_values in memory that this module owns and writes. `shown` points to
// them.
typedef struct pm_port_instance_end {
    int ny;
    double *y, *e, *eta, *response;
    pm_port_values shown;
} pm_port_instance_end;

typedef struct pm_port_instance {
    int port_id;          // position of the port in the scene
    pm_end end;           // the end of the port at which the subsystem is
    const int *component; // [own.ny] position in z of each exposed component
    pm_port_instance_end own;
    const pm_scene_boundary_input *boundary_input; // at the other end; NULL: a subsystem is there
    bool contact;                 // the law is `contact`; `outside` then holds its end values
    const int *outside_component; // [outside.ny] positions in the boundary input's state
    pm_port_instance_end outside;

    pm_program *program;           // the law's graph; NULL: the law has no effect here
    pm_port_instance_end input[2]; // inputs of the graph by end; NULL: the rates ignore them
    // Rates [ny] at this end and at the other end. The latter is NULL unless this instance serves
    // both ends, or the other end is a boundary input.
    const double *rate[2];
    // [ny] predicted co-energies with which the law is evaluated, in the order of `rate`; NULL: the
    // law is evaluated with e.
    const double *law_e[2];
    // [nboth] irreversible rates of both ends, from which the law predicts co-energies: those of
    // the last iteration, and those of this one. NULL without prediction.
    double *last;
    const double *next;
    int nboth;
    bool known;                          // the rates were computed from the present inputs
    bool renewed;                        // the last coupling ran the graph
    bool shared;                         // this instance evaluates the other end's rate too
    const struct pm_port_instance *peer; // the instance that evaluates this end too; NULL: none
    pm_flux booking, outside_booking;    // sums over the step under way
} pm_port_instance;

// Builds the law's graph for one end of port number `port_id`. Memory comes from the arena; the
// caller closes. PM_ENOMEM.
pm_status pm_port_instance_open(pm_port_instance *j, pm_arena *arena, const pm_system *system,
                                const pm_integrator *integrator, int port_id, pm_end end);
void pm_port_instance_close(pm_port_instance *j);

// Lets the instance `here` evaluate the law for both ends of a port, with one graph instead of two.
// `there` is the instance of the other end, in the same process. In every round (one stage of one
// substep) pm_port_instance_couple must be called for `here` before it is called for `there`. After
// one of them is closed, the other may not be used. Does nothing for a law that computes the rates
// of its two ends with separate networks, such as `exchange`. PM_ENOMEM.
pm_status pm_port_instance_share(pm_port_instance *here, pm_port_instance *there,
                                 const pm_system *system, const pm_integrator *integrator);

// Computes the values that this end shows from the subsystem's z, dE, dS and response, all [nz].
// The last three may be NULL: zero.
void pm_port_instance_expose(pm_port_instance *j, const double *z, const double *dE,
                             const double *dS, const double *response);

// Computes the values that the boundary input shows at the other end, from the values of all
// boundary inputs [scene->nprescribed], and returns them.
const pm_port_values *pm_port_instance_prescribe(pm_port_instance *j, const double *prescribed);

// Returns what the other end shows at the end of the substep, for a solid, which is in balance
// there: for the law `contact` the response of the gap as its co-energy (contact_gap.h), else
// `other`.
const pm_port_values *pm_port_instance_end_values(pm_port_instance *j, const pm_port_values *other);

// Adds the law's rate to k [nz], in units of z per second, and its fluxes, times `weight`, to the
// sums `booking` and `outside_booking`. `other` is what the other end shows; `first` marks the
// first stage of a substep. Returns true if the graph was run. It is not run if the law has no
// effect or if no bit of its inputs has changed.
bool pm_port_instance_couple(pm_port_instance *j, const pm_port_values *other, bool first,
                             double weight, double *k);

// Puts the inputs of the law into the record. The stage after restoring compares its inputs with
// these. Restoring runs the graph.
void pm_port_instance_record(pm_port_instance *j, pm_record *record);

#endif
