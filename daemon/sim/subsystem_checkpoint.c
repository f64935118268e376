// What one subsystem needs to go on from the end of a step with the same bits, as a row of numbers:
// the step and the counts; the booked fluxes; the projection; the last inputs of the bulk term and
// of the port laws, from which the first step knows what has not changed; and the state.
#include "sim/subsystem_parts.h"

#define COUNTS 4     // steps; graphs evaluated and skipped; steps outside the training range
#define FLUX 4       // numbers of a pm_flux
#define PROJECTION 4 // numbers of a pm_invariant_projection

int pm_subsystem_checkpoint_size(const pm_subsystem *s) {
    int count = COUNTS + FLUX * (1 + s->books.nflux) + PROJECTION +
                pm_local_dynamics_checkpoint_size(&s->dynamics) + s->nz;
    for (int i = 0; i < s->nport; ++i) {
        count += pm_port_instance_checkpoint_size(&s->port[i]);
    }
    return count;
}

static double *put_flux(const pm_flux *flux, double *checkpoint) {
    const double number[FLUX] = {flux->energy, flux->entropy, flux->energy_gross,
                                 flux->entropy_gross};
    memcpy(checkpoint, number, sizeof number);
    return checkpoint + FLUX;
}

static const double *get_flux(pm_flux *flux, const double *checkpoint) {
    *flux = (pm_flux){checkpoint[0], checkpoint[1], checkpoint[2], checkpoint[3]};
    return checkpoint + FLUX;
}

void pm_subsystem_save(const pm_subsystem *s, double *checkpoint) {
    *checkpoint++ = (double)s->step;
    *checkpoint++ = (double)s->books.evaluated;
    *checkpoint++ = (double)s->books.skipped;
    *checkpoint++ = (double)s->books.outside;
    checkpoint = put_flux(&s->books.bulk, checkpoint);
    for (int i = 0; i < s->books.nflux; ++i) {
        checkpoint = put_flux(&s->flux[i], checkpoint);
    }
    *checkpoint++ = s->projection.energy;
    *checkpoint++ = s->projection.energy_gross;
    *checkpoint++ = s->projection.entropy;
    *checkpoint++ = s->projection.entropy_gross;
    pm_local_dynamics_save(&s->dynamics, checkpoint);
    checkpoint += pm_local_dynamics_checkpoint_size(&s->dynamics);
    for (int i = 0; i < s->nport; ++i) {
        pm_port_instance_save(&s->port[i], checkpoint);
        checkpoint += pm_port_instance_checkpoint_size(&s->port[i]);
    }
    pm_subsystem_copy(checkpoint, s->z, s->nz);
}

void pm_subsystem_restore(pm_subsystem *s, const double *checkpoint) {
    const double *count = checkpoint;
    pm_subsystem_set_state(s, checkpoint + pm_subsystem_checkpoint_size(s) - s->nz);
    s->step = (long)count[0];
    s->booking.evaluated = s->books.evaluated = (long)count[1];
    s->booking.skipped = s->books.skipped = (long)count[2];
    s->booking.outside = s->books.outside = (long)count[3];
    checkpoint = get_flux(&s->books.bulk, checkpoint + COUNTS);
    for (int i = 0; i < s->books.nflux; ++i) {
        checkpoint = get_flux(&s->flux[i], checkpoint);
    }
    s->projection = s->safe_projection =
        (pm_invariant_projection){checkpoint[0], checkpoint[1], checkpoint[2], checkpoint[3]};
    checkpoint += PROJECTION;
    pm_local_dynamics_restore(&s->dynamics, checkpoint);
    checkpoint += pm_local_dynamics_checkpoint_size(&s->dynamics);
    for (int i = 0; i < s->nport; ++i) {
        pm_port_instance_restore(&s->port[i], checkpoint);
        checkpoint += pm_port_instance_checkpoint_size(&s->port[i]);
    }
}
