// A node's reports and states.
#include "net/reporter.h"

#include <string.h>

#include "net/channel.h"

static pm_status make_report(pm_reporter *r, pm_arena *arena, portmet_report_t *report, int nport) {
    const size_t n = (size_t)nport;
    double *memory = pm_arena_array(arena, 4 * n, sizeof(double));
    if (memory == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", r->subsystem->name);
    }
    *report = (portmet_report_t){
        .digest = r->digest,
        .nport = nport,
        .energy_flux = memory,
        .entropy_flux = memory + n,
        .energy_gross = memory + 2 * n,
        .entropy_gross = memory + 3 * n,
        .message = "",
    };
    return PM_OK;
}

pm_status pm_reporter_init(pm_reporter *reporter, pm_arena *arena, const pm_system *system,
                           int subsystem_id, int nport, pm_transport *transport) {
    const pm_scene *scene = system->scene;
    reporter->subsystem = &scene->subsystem[subsystem_id];
    reporter->transport = transport;
    reporter->digest = (int64_t)system->digest;
    PM_TRY(pm_channel_subsystem(reporter->report.channel, scene, "REPORT", subsystem_id));
    PM_TRY(pm_channel_subsystem(reporter->state.channel, scene, "STATE", subsystem_id));
    PM_TRY(make_report(reporter, arena, &reporter->done, nport));
    PM_TRY(make_report(reporter, arena, &reporter->word, nport));
    const size_t size = pm_report_size(&reporter->done);
    reporter->word_capacity = size + PM_TEXT_MAX;
    reporter->word_data = pm_arena_alloc(arena, reporter->word_capacity);
    if (reporter->word_data == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory", reporter->subsystem->name);
    }
    // The coordinator may miss the report of any granted step.
    const int depth = scene->window + 1;
    PM_TRY(pm_outbox_init(&reporter->report, arena, depth, size));
    const portmet_state_t shape = {.nz = reporter->subsystem->layout.nz};
    return pm_outbox_init(&reporter->state, arena, depth, pm_state_size(&shape));
}

pm_status pm_reporter_say(pm_reporter *reporter, int64_t session, int8_t kind, pm_status code,
                          const char *message) {
    portmet_report_t *m = &reporter->word;
    m->session = session;
    m->kind = kind;
    m->code = (int8_t)code;
    m->message = (char *)message;
    const size_t size = pm_report_encode(m, reporter->word_data, reporter->word_capacity);
    return pm_transport_publish(reporter->transport, reporter->report.channel, reporter->word_data,
                                size);
}

static pm_status not_finite(const pm_reporter *reporter, const char *what, int64_t step) {
    return pm_fail(PM_ENUMERIC, "subsystem %s: %s not finite after %lld steps",
                   reporter->subsystem->name, what, (long long)step);
}

static pm_status publish_state(pm_reporter *reporter, int64_t session, int64_t step, double time,
                               const double *z) {
    const portmet_state_t message = {
        .session = session,
        .step = step,
        .time = time,
        .nz = reporter->subsystem->layout.nz,
        .z = (double *)z,
    };
    unsigned char *data = pm_outbox_data(&reporter->state, step);
    const size_t size = pm_state_encode(&message, data, reporter->state.capacity);
    if (size == 0) {
        return not_finite(reporter, "the state is", step);
    }
    return pm_outbox_publish(&reporter->state, reporter->transport, step, size);
}

pm_status pm_reporter_done(pm_reporter *reporter, int64_t session, int64_t step, double time,
                           const pm_books *books, const double *z) {
    portmet_report_t *m = &reporter->done;
    m->session = session;
    m->kind = PORTMET_REPORT_T_DONE;
    m->step = step;
    m->time = time;
    m->energy = books->energy;
    m->entropy = books->entropy;
    m->bulk_energy = books->bulk_energy;
    m->bulk_entropy = books->bulk_entropy;
    m->bulk_energy_gross = books->bulk_gross[0];
    m->bulk_entropy_gross = books->bulk_gross[1];
    m->evaluated = books->evaluated;
    m->skipped = books->skipped;
    for (int i = 0; i < m->nport; ++i) {
        m->energy_flux[i] = books->flux[i].energy;
        m->entropy_flux[i] = books->flux[i].entropy;
        m->energy_gross[i] = books->flux[i].energy_gross;
        m->entropy_gross[i] = books->flux[i].entropy_gross;
    }
    unsigned char *data = pm_outbox_data(&reporter->report, step);
    const size_t size = pm_report_encode(m, data, reporter->report.capacity);
    if (size == 0) {
        return not_finite(reporter, "energy, entropy or a flux is", step);
    }
    PM_TRY(pm_outbox_publish(&reporter->report, reporter->transport, step, size));
    return z == NULL ? PM_OK : publish_state(reporter, session, step, time, z);
}

pm_status pm_reporter_repeat(const pm_reporter *reporter, const portmet_request_t *request) {
    const pm_outbox *const outbox[] = {&reporter->report, &reporter->state};
    for (int i = 0; i < 2; ++i) {
        if (strcmp(request->channel, outbox[i]->channel) == 0) {
            PM_TRY(pm_outbox_repeat(outbox[i], reporter->transport, request->step));
        }
    }
    return PM_OK;
}
