// One port as one of its subsystems sees it: what this end shows, what the port law makes of it and
// of the other end's values, and what flows in. Where the other end is a load, the joint stands in
// for the world there too. Used by subsystem.c alone; pm_port_values travels.
#ifndef PM_SIM_PORT_INSTANCE_H
#define PM_SIM_PORT_INSTANCE_H

#include "graph/program.h"
#include "scene/boundary_input.h"
#include "scene/integrator.h"
#include "scene/recording.h"
#include "scene/system.h"

// What one end of a port shows at a stage. Arrays of ny numbers.
typedef struct pm_port_values {
    int ny;
    const double *y, *e, *eta; // state, dE/dy, dS/dy; eta is all zero without entropy
    const double *response; // slope of e per unit of rate; NULL unless the integrator is discrete
} pm_port_values;

// The same with room to write to.
typedef struct pm_port_instance_end {
    int ny;
    double *y, *e, *eta, *response;
    pm_port_values shown;
} pm_port_instance_end;

typedef struct pm_port_instance {
    int port_id;
    pm_end end;
    const int *component; // [own.ny] position in z of what is exposed
    pm_port_instance_end own;
    // The other end, if it is a load.
    const pm_scene_boundary_input *boundary_input; // NULL: it is a subsystem
    const int *world_component;
    pm_port_instance_end world;

    // The port law's graph, and where its numbers go in and out. NULL where a law needs none.
    pm_program *program;
    pm_port_instance_end input[2]; // NULL: the rates do not depend on it
    const double *rate[2];  // [ny] into the subsystem, into the other end if it is evaluated here
    const double *law_e[2]; // [ny] predicted co-energies the law was evaluated at; NULL: e itself
    // [nboth] irreversible rate of the iteration before, and of this one; NULL if not predicted.
    double *last;
    const double *next;
    int nboth;
    bool known;   // the rates belong to the inputs
    bool renewed; // they were evaluated when last coupled
    bool shared;  // the other end's rate is evaluated here too
    const struct pm_port_instance
        *peer;                      // that evaluates the law for this end; NULL: it is done here
    pm_flux booking, world_booking; // over the step under way
} pm_port_instance;

// Builds the law's graph; memory from the arena. PM_ENOMEM. Zero-initialise before.
pm_status pm_port_instance_open(pm_port_instance *j, pm_arena *arena, const pm_system *system,
                                const pm_integrator *integrator, int port_id, pm_end end);
void pm_port_instance_close(pm_port_instance *j);

// Lets `here` evaluate the law for both ends, for a port whose subsystems step together. In every
// round `here` is coupled before `there`. PM_ENOMEM.
pm_status pm_port_instance_share(pm_port_instance *here, pm_port_instance *there,
                                 const pm_system *system, const pm_integrator *integrator);

// What the subsystem's z, dE, dS and response show here; dE, dS and response may be NULL: zero.
void pm_port_instance_expose(pm_port_instance *j, const double *z, const double *dE,
                             const double *dS, const double *response);

// What the world shows at its end, from the values of all loads.
const pm_port_values *pm_port_instance_prescribe(pm_port_instance *j, const double *prescribed);

// Adds the law's rate to k [nz], and the fluxes, weighted, to the bookings. `first`: no stage of
// this substep came before. False: nothing was evaluated, as the law has nothing here, or all that
// it depends on has the bits of the time before.
bool pm_port_instance_couple(pm_port_instance *j, const pm_port_values *other, bool first,
                             double weight, double *k);

// What the law was evaluated with, so that another joint knows it too: how many numbers, and these.
// Restoring evaluates it.
int pm_port_instance_checkpoint_size(const pm_port_instance *j);
void pm_port_instance_save(const pm_port_instance *j, double *memory);
void pm_port_instance_restore(pm_port_instance *j, const double *memory);

// Where an input of a program is written; NULL if no output depends on it, or for PM_NO_NODE: then
// it need not be looked at.
double *pm_input_of(pm_program *program, pm_node x);

// Copies; true if that changed a bit. to or from may be NULL: nothing to do.
bool pm_renew(double *to, const double *from, int n);

// Adds a term's power and entropy production. e or eta may be NULL: zero.
void pm_flux_book(pm_flux *flux, double weight, int n, const double *e, const double *eta,
                  const double *rate);

#endif
