// The numbers with which one subsystem goes on from the end of a step with the same bits: the
// state; the step and the counts; the booked fluxes; the projection; and the last inputs of the
// bulk term and of the port laws, from which the first step knows what has not changed.
#include "sim/subsystem_parts.h"

static void put_flux(pm_record *record, const char *name, pm_flux *flux) {
    pm_record_put(record, name, &flux->energy, 1);
    pm_record_put(record, name, &flux->entropy, 1);
    pm_record_put(record, name, &flux->energy_gross, 1);
    pm_record_put(record, name, &flux->entropy_gross, 1);
}

static void put_books(pm_record *record, pm_subsystem *s) {
    pm_record_put_long(record, "evaluated", &s->books.evaluated);
    pm_record_put_long(record, "skipped", &s->books.skipped);
    pm_record_put_long(record, "outside", &s->books.outside);
    put_flux(record, "bulk", &s->books.bulk);
    for (int i = 0; i < s->books.nflux; ++i) {
        put_flux(record, "flux", &s->flux[i]);
    }
}

static void put_projection(pm_record *record, pm_invariant_projection *projection) {
    pm_record_put(record, "projected energy", &projection->energy, 1);
    pm_record_put(record, "projected energy, gross", &projection->energy_gross, 1);
    pm_record_put(record, "projected entropy", &projection->entropy, 1);
    pm_record_put(record, "projected entropy, gross", &projection->entropy_gross, 1);
}

void pm_subsystem_record(pm_subsystem *s, pm_record *record) {
    pm_record_put(record, "z", s->z, s->nz);
    if (pm_record_restores(record)) {
        pm_subsystem_set_state(s, s->z); // starts anew; the numbers below replace what it counts
    }
    pm_record_put_long(record, "step", &s->step);
    put_books(record, s);
    put_projection(record, &s->projection);
    pm_local_dynamics_record(&s->dynamics, record);
    for (int i = 0; i < s->nport; ++i) {
        pm_port_instance_record(&s->port[i], record);
    }
    if (pm_record_restores(record)) {
        s->booking.evaluated = s->books.evaluated;
        s->booking.skipped = s->books.skipped;
        s->booking.outside = s->books.outside;
        s->safe_projection = s->projection;
    }
}
