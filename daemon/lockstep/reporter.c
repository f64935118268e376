// Fills, publishes and repeats a process's reports.
#include "lockstep/reporter.h"

#include <string.h>

#include "lockstep/lookahead.h"
#include "transport/channel.h"

pm_status pm_reporter_init(pm_reporter *reporter, pm_arena *arena, const pm_system *system,
                           int process_id, pm_transport *transport, int64_t instance, int more) {
    pm_reporter *r = reporter;
    const pm_scene *scene = system->scene;
    r->scene = scene;
    r->process = &scene->process[process_id];
    r->transport = transport;
    PM_TRY(pm_channel_process(r->sent.channel, scene, "REPORT", process_id));
    PM_TRY(pm_report_shapes_init(r->shape, arena, scene, process_id));
    PM_TRY(pm_report_message_alloc(&r->done, arena, r->shape));
    // The coordinator may miss the report of any granted step, and a report may hold only one.
    const int depth = pm_lookahead(scene) + 1 + more;
    PM_TRY(pm_resend_buffer_init(&r->sent, arena, depth, pm_report_size(&r->done)));
    r->notice = (portmet_report_t){.instance = instance, .digest = (int64_t)system->digest};
    r->notice_capacity = pm_report_size(&(portmet_report_t){.message = ""}) + PM_TEXT_MAX;
    r->notice_data = pm_arena_alloc(arena, r->notice_capacity);
    r->first = pm_arena_array(arena, (size_t)depth, sizeof *r->first);
    r->last = pm_arena_array(arena, (size_t)depth, sizeof *r->last);
    r->done.instance = instance;
    r->done.digest = r->notice.digest;
    r->done.kind = PORTMET_REPORT_T_DONE;
    return r->notice_data != NULL && r->first != NULL && r->last != NULL
               ? PM_OK
               : pm_fail(PM_ENOMEM, "%s: out of memory", r->process->name);
}

// --- FAILED and BYE ---

pm_status pm_reporter_notify(pm_reporter *reporter, int64_t session, int64_t coordinator,
                             int8_t kind, pm_status code, const char *message) {
    portmet_report_t *m = &reporter->notice;
    m->session = session;
    m->coordinator = coordinator;
    m->kind = kind;
    m->code = (int8_t)code;
    m->message = (char *)message;
    const size_t size = pm_report_encode(m, reporter->notice_data, reporter->notice_capacity);
    return pm_transport_publish(reporter->transport, reporter->sent.channel, reporter->notice_data,
                                size);
}

// --- steps ---

// Writes one subsystem's books to position `part` and to the ends from `end` on. Returns the end
// after these.
static int add_books(portmet_report_t *m, int part, int end, const pm_books *books) {
    m->energy[part] = books->energy;
    m->entropy[part] = books->entropy;
    m->bulk_energy[part] = books->bulk.energy;
    m->bulk_entropy[part] = books->bulk.entropy;
    m->bulk_energy_gross[part] = books->bulk.energy_gross;
    m->bulk_entropy_gross[part] = books->bulk.entropy_gross;
    m->evaluated[part] = books->evaluated;
    m->skipped[part] = books->skipped;
    m->outside[part] = books->outside;
    m->error[part] = books->error;
    for (int i = 0; i < books->nflux; ++i, ++end) {
        m->energy_flux[end] = books->flux[i].energy;
        m->entropy_flux[end] = books->flux[i].entropy;
        m->energy_gross[end] = books->flux[i].energy_gross;
        m->entropy_gross[end] = books->flux[i].entropy_gross;
    }
    return end;
}

static bool is_finite(const pm_books *books) {
    double nothing = 0 * books->energy + 0 * books->entropy + 0 * books->error;
    const pm_flux *flux = &books->bulk;
    for (int i = 0; i <= books->nflux; flux = &books->flux[i++]) {
        nothing +=
            0 * flux->energy + 0 * flux->entropy + 0 * flux->energy_gross + 0 * flux->entropy_gross;
    }
    return nothing == 0;
}

// A report with a number that is not finite cannot be encoded. The steps before it are published,
// and the run ends.
static pm_status check_books(pm_reporter *r, int64_t step,
                             const pm_process_subsystems *subsystems) {
    for (int i = 0; i < subsystems->count; ++i) {
        const pm_books books = pm_local_subsystems_books(subsystems->local, i);
        if (!is_finite(&books)) {
            PM_TRY(pm_reporter_flush(r));
            return pm_fail(PM_ENUMERIC, "subsystem %s: a flux is not finite in step %lld",
                           r->scene->subsystem[r->process->subsystem[i]].name, (long long)step);
        }
    }
    return PM_OK;
}

// Adds the sums of the step to the report.
static void add_tally(pm_reporter *r, const pm_process_subsystems *subsystems) {
    pm_tally tally = {0};
    pm_local_subsystems_tally(subsystems->local, &tally);
    memcpy(r->done.tally + (ptrdiff_t)r->rows * PM_TALLY_NUMBERS, &tally, sizeof tally);
}

pm_status pm_reporter_add_step(pm_reporter *reporter, const portmet_report_t *head,
                               const pm_process_subsystems *subsystems, bool with_state) {
    pm_reporter *r = reporter;
    portmet_report_t *m = &r->done;
    r->sums = r->shape[1].ntally > 0 && !with_state;
    const pm_report_shape *shape = &r->shape[r->sums];
    if (r->rows == 0) {
        m->session = head->session;
        m->coordinator = head->coordinator;
        m->step = head->step;
        m->time = head->time;
        m->nz = 0;
    }
    if (r->sums) {
        add_tally(r, subsystems);
    } else {
        PM_TRY(check_books(r, head->step, subsystems));
    }
    int end = r->rows * shape->nend;
    for (int i = 0; i < shape->npart; ++i) {
        const int part = shape->part[i];
        const pm_books books = pm_local_subsystems_books(subsystems->local, part);
        end = add_books(m, r->rows * shape->npart + i, end, &books);
        if (with_state) {
            pm_local_subsystems_state(subsystems->local, part, m->z + m->nz);
            m->nz += r->scene->subsystem[r->process->subsystem[part]].layout.nz;
        }
    }
    r->rows += 1;
    return r->rows < shape->rows ? PM_OK : pm_reporter_flush(r);
}

pm_status pm_reporter_flush(pm_reporter *reporter) {
    pm_reporter *r = reporter;
    portmet_report_t *m = &r->done;
    if (r->rows == 0) {
        return PM_OK;
    }
    m->npart = r->rows * r->shape[r->sums].npart;
    m->nend = r->rows * r->shape[r->sums].nend;
    m->ntally = r->rows * r->shape[r->sums].ntally;
    const int64_t last = m->step + r->rows - 1;
    r->rows = 0;
    unsigned char *data = pm_resend_buffer_data(&r->sent);
    const size_t size = pm_report_encode(m, data, r->sent.capacity);
    if (size == 0) {
        return pm_fail(PM_ENUMERIC,
                       "process %s: a state, energy, entropy or flux is not finite after step "
                       "%lld to %lld",
                       r->process->name, (long long)m->step, (long long)last);
    }
    r->first[r->count % r->sent.depth] = m->step;
    r->last[r->count % r->sent.depth] = last;
    return pm_resend_buffer_publish(&r->sent, r->transport, r->count++, size);
}

pm_status pm_reporter_repeat(const pm_reporter *reporter, int64_t step, bool *kept) {
    const pm_reporter *r = reporter;
    const int64_t oldest = r->count > r->sent.depth ? r->count - r->sent.depth : 0;
    for (int64_t i = oldest; i < r->count; ++i) {
        const int64_t slot = i % r->sent.depth;
        if (r->first[slot] <= step && step <= r->last[slot]) {
            *kept = true;
            return pm_resend_buffer_repeat(&r->sent, r->transport, i);
        }
    }
    *kept = false;
    return PM_OK;
}
