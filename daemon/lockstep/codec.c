// Each wire type is described once, as a table of its fields (wire_format.h).
#include "lockstep/codec.h"

// --- the tables ---

#define F(kind, type, name) \
    { PM_WIRE_##kind, offsetof(portmet_##type##_t, name), 0 }
#define ARRAY(kind, type, name, length) \
    { PM_WIRE_##kind, offsetof(portmet_##type##_t, name), offsetof(portmet_##type##_t, length) }

static const pm_wire_type hello_type = {
    __portmet_hello_t_get_hash,
    8,
    {F(I64, hello, protocol), F(I64, hello, session), F(I64, hello, instance), F(I64, hello, nonce),
     F(I64, hello, coordinator), F(I64, hello, digest), F(I64, hello, checkpoint),
     F(TEXT, hello, sender)},
};

static const pm_wire_type flux_type = {
    __portmet_flux_t_get_hash,
    15,
    {F(I64, flux, session), F(I64, flux, step), F(I32, flux, round), F(DOUBLE, flux, time),
     F(COUNT, flux, nend), ARRAY(DOUBLES, flux, energy_flux, nend),
     ARRAY(DOUBLES, flux, entropy_flux, nend), F(COUNT, flux, ny), ARRAY(DOUBLES, flux, y, ny),
     ARRAY(DOUBLES, flux, e, ny), ARRAY(DOUBLES, flux, eta, ny), F(COUNT, flux, nresponse),
     ARRAY(DOUBLES, flux, response, nresponse), F(COUNT, flux, nknown),
     ARRAY(I64S, flux, known, nknown)},
};

static const pm_wire_type tick_type = {
    __portmet_tick_t_get_hash,
    14,
    {F(I64, tick, session), F(I64, tick, instance), F(I64, tick, digest), F(I64, tick, granted),
     F(I64, tick, steps), F(DOUBLE, tick, t0), F(DOUBLE, tick, dt), F(I32, tick, substeps),
     F(BOOLEAN, tick, want_state), F(BOOLEAN, tick, open), F(COUNT_TO, tick, nanswer),
     ARRAY(I64S, tick, answer, nanswer), F(COUNT, tick, nlive), ARRAY(DOUBLES, tick, live, nlive)},
};

static const pm_wire_type report_type = {
    __portmet_report_t_get_hash,
    29,
    {F(I64, report, session),
     F(I64, report, instance),
     F(I64, report, coordinator),
     F(I64, report, digest),
     F(I8, report, kind),
     F(I8, report, code),
     F(I64, report, step),
     F(DOUBLE, report, time),
     F(COUNT_TO, report, npart),
     ARRAY(DOUBLES, report, energy, npart),
     ARRAY(DOUBLES, report, entropy, npart),
     ARRAY(DOUBLES, report, bulk_energy, npart),
     ARRAY(DOUBLES, report, bulk_entropy, npart),
     ARRAY(DOUBLES, report, bulk_energy_gross, npart),
     ARRAY(DOUBLES, report, bulk_entropy_gross, npart),
     ARRAY(I64S, report, evaluated, npart),
     ARRAY(I64S, report, skipped, npart),
     ARRAY(I64S, report, outside, npart),
     ARRAY(DOUBLES, report, error, npart),
     F(COUNT_TO, report, nend),
     ARRAY(DOUBLES, report, energy_flux, nend),
     ARRAY(DOUBLES, report, entropy_flux, nend),
     ARRAY(DOUBLES, report, energy_gross, nend),
     ARRAY(DOUBLES, report, entropy_gross, nend),
     F(COUNT_TO, report, nz),
     ARRAY(DOUBLES, report, z, nz),
     F(COUNT_TO, report, ntally),
     ARRAY(DOUBLES, report, tally, ntally),
     F(TEXT, report, message)},
};

static const pm_wire_type ledger_type = {
    __portmet_ledger_t_get_hash,
    8,
    {F(I64, ledger, session), F(I64, ledger, step), F(DOUBLE, ledger, time),
     F(DOUBLE, ledger, energy), F(DOUBLE, ledger, entropy), F(DOUBLE, ledger, energy_residual),
     F(DOUBLE, ledger, entropy_residual), F(I64, ledger, violations)},
};

static const pm_wire_type vitals_type = {
    __portmet_vitals_t_get_hash,
    16,
    {F(I64, vitals, session), F(I32, vitals, process), F(I64, vitals, step),
     F(DOUBLE, vitals, elapsed), F(DOUBLE, vitals, computing), F(DOUBLE, vitals, cpu),
     F(I64, vitals, rss), F(DOUBLE, vitals, checkpoint_age), F(COUNT_TO, vitals, npeer),
     ARRAY(I64S, vitals, peer, npeer), ARRAY(DOUBLES, vitals, waited, npeer),
     ARRAY(I64S, vitals, asked, npeer), ARRAY(I64S, vitals, used, npeer),
     ARRAY(I64S, vitals, answered, npeer), F(COUNT_TO, vitals, ndrop),
     ARRAY(I64S, vitals, drops, ndrop)},
};

static const pm_wire_type health_type = {
    __portmet_health_t_get_hash,
    22,
    {F(I64, health, session),
     F(I64, health, digest),
     F(I64, health, step),
     F(I64, health, steps),
     F(DOUBLE, health, rate),
     F(I64, health, blocker),
     F(COUNT, health, nprocess),
     ARRAY(I64S, health, process_step, nprocess),
     ARRAY(DOUBLES, health, process_rate, nprocess),
     ARRAY(DOUBLES, health, silent, nprocess),
     ARRAY(DOUBLES, health, cpu, nprocess),
     ARRAY(DOUBLES, health, computing, nprocess),
     ARRAY(I64S, health, waits_for, nprocess),
     ARRAY(DOUBLES, health, waits_part, nprocess),
     ARRAY(DOUBLES, health, asks, nprocess),
     ARRAY(DOUBLES, health, answers, nprocess),
     ARRAY(I64S, health, loses_from, nprocess),
     ARRAY(DOUBLES, health, loss, nprocess),
     ARRAY(I64S, health, drops, nprocess),
     ARRAY(I64S, health, strange, nprocess),
     ARRAY(DOUBLES, health, checkpoint_age, nprocess),
     ARRAY(I64S, health, rss, nprocess)},
};

static const pm_wire_type command_type = {
    __portmet_command_t_get_hash,
    7,
    {F(I64, command, session), F(I64, command, instance), F(I64, command, addressee),
     F(I64, command, answer), F(I8, command, kind), F(I8, command, code), F(TEXT, command, reason)},
};

static const pm_wire_type request_type = {
    __portmet_request_t_get_hash,
    7,
    {F(I64, request, session), F(TEXT, request, sender), F(I64, request, instance),
     F(I64, request, attempt), F(TEXT, request, channel), F(I64, request, step),
     F(I32, request, round)},
};

// --- the typed functions ---

int64_t pm_protocol(void) {
    static const pm_wire_type *const type[] = {&flux_type,   &tick_type,    &report_type,
                                               &ledger_type, &command_type, &request_type,
                                               &vitals_type, &health_type};
    uint64_t sum = 0;
    for (size_t i = 0; i < sizeof type / sizeof type[0]; ++i) {
        sum += (uint64_t)type[i]->fingerprint();
    }
    return (int64_t)sum;
}

#define CODEC(type)                                                                             \
    pm_drop pm_##type##_decode(portmet_##type##_t *message, const void *data, size_t size) {    \
        return pm_wire_decode(&type##_type, message, data, size);                               \
    }                                                                                           \
    size_t pm_##type##_encode(const portmet_##type##_t *message, void *data, size_t capacity) { \
        return pm_wire_encode(&type##_type, message, data, capacity);                           \
    }

CODEC(hello)
CODEC(flux)
CODEC(tick)
CODEC(report)
CODEC(ledger)
CODEC(command)
CODEC(request)
CODEC(vitals)
CODEC(health)

size_t pm_flux_size(const portmet_flux_t *message) {
    return pm_wire_size(&flux_type, message);
}

size_t pm_vitals_size(const portmet_vitals_t *message) {
    return pm_wire_size(&vitals_type, message);
}

size_t pm_health_size(const portmet_health_t *message) {
    return pm_wire_size(&health_type, message);
}

size_t pm_tick_size(const portmet_tick_t *message) {
    return pm_wire_size(&tick_type, message);
}

size_t pm_report_size(const portmet_report_t *message) {
    return pm_wire_size(&report_type, message);
}
