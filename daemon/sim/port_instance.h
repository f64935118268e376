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
    // d e/d rate, by which a discrete integrator predicts e at the end of the step; else NULL.
    const double *response;
} pm_port_values;

// The same four arrays in memory that this module owns and writes.
typedef struct pm_port_instance_end {
    int ny;
    double *y, *e, *eta, *response;
    pm_port_values shown;
} pm_port_instance_end;

typedef struct pm_port_instance {
    int port_id;          // position of the port in the scene
    pm_end end;           // which end of it this is
    const int *component; // [own.ny] position in z of each exposed component
    pm_port_instance_end own;
    const pm_scene_boundary_input *boundary_input; // at the other end; NULL: it is a subsystem
    const int *outside_component;                  // [outside.ny] likewise, of the boundary input
    pm_port_instance_end outside;

    pm_program *program;           // the law's graph; NULL: the law has no effect here
    pm_port_instance_end input[2]; // inputs of the graph by end; NULL: the rates ignore them
    const double *rate[2];         // [ny] into the subsystem; into the other end if evaluated here
    const double *law_e[2]; // [ny] predicted co-energies at which the law is taken; NULL: e itself
    // [nboth] irreversible rates of both ends, by which the law predicts co-energies: the result of
    // the iteration before, and of this one. NULL without prediction.
    double *last;
    const double *next;
    int nboth;
    bool known;                          // the rates belong to the inputs
    bool renewed;                        // the last coupling ran the graph
    bool shared;                         // this instance evaluates the other end's rate too
    const struct pm_port_instance *peer; // the instance that evaluates for this one; NULL: itself
    pm_flux booking, outside_booking;    // sums over the step under way
} pm_port_instance;

// Builds the law's graph for one end of port number `port_id`. Memory comes from the arena; the
// caller closes. PM_ENOMEM.
pm_status pm_port_instance_open(pm_port_instance *j, pm_arena *arena, const pm_system *system,
                                const pm_integrator *integrator, int port_id, pm_end end);
void pm_port_instance_close(pm_port_instance *j);

// Lets `here` evaluate the law for both ends of a port whose subsystems are in one process, with
// one graph instead of two. In every round (one stage of one substep) pm_port_instance_couple must
// be called for `here` before it is called for `there`. Neither may be used once the other is
// closed. Does nothing for a law that computes the rates of its two ends with separate networks,
// such as `exchange`. PM_ENOMEM.
pm_status pm_port_instance_share(pm_port_instance *here, pm_port_instance *there,
                                 const pm_system *system, const pm_integrator *integrator);

// Computes the values that this end shows from the subsystem's z, dE, dS and response, all [nz].
// The last three may be NULL: zero.
void pm_port_instance_expose(pm_port_instance *j, const double *z, const double *dE,
                             const double *dS, const double *response);

// Computes the values that the boundary input shows at the other end, from the values of all
// boundary inputs [scene->nprescribed], and returns them.
const pm_port_values *pm_port_instance_prescribe(pm_port_instance *j, const double *prescribed);

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
