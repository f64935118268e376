// Fills, publishes and repeats a process's reports.
#include "lockstep/reporter.h"

#include <string.h>

#include "lockstep/lookahead.h"
#include "transport/channel.h"

#define LARGEST_REPORT 32768 // bytes of numbers in a report of several steps; avoids fragments

// --- the shape of a report message ---

// Counts the subsystems, ends of ports and components of the state in the report of one step.
static void count_numbers(const pm_scene *scene, int process_id, int *npart, int *nend, int *nz) {
    const pm_scene_process *process = &scene->process[process_id];
    *npart = process->count;
    *nend = *nz = 0;
    for (int i = 0; i < process->count; ++i) {
        *nz += scene->subsystem[process->subsystem[i]].layout.nz;
    }
    for (int k = 0; k < 2 * scene->nport; ++k) {
        // The subsystem at one end also reports the end at a boundary input.
        const int *subsystem = scene->port[k / 2].subsystem;
        const int by = subsystem[k % 2] >= 0 ? subsystem[k % 2] : subsystem[1 - k % 2];
        *nend += scene->subsystem[by].process == process_id;
    }
}

// Returns the largest number of steps in a report of this process.
static int most_rows(const pm_scene *scene, int process_id) {
    int npart, nend, nz;
    count_numbers(scene, process_id, &npart, &nend, &nz);
    const size_t size = sizeof(double) * (10 * (size_t)npart + 4 * (size_t)nend + (size_t)nz);
    const int most = size < LARGEST_REPORT ? (int)(LARGEST_REPORT / size) : 1;
    const int lookahead = pm_lookahead(scene), half = lookahead > 1 ? lookahead / 2 : 1;
    return half < most ? half : most;
}

pm_status pm_report_message_alloc(portmet_report_t *report, pm_arena *arena, const pm_scene *scene,
                                  int process_id) {
    int npart, nend, nz;
    count_numbers(scene, process_id, &npart, &nend, &nz);
    const int rows = most_rows(scene, process_id);
    *report = (portmet_report_t){
        .npart = rows * npart, .nend = rows * nend, .nz = rows * nz, .message = ""};
    const size_t p = (size_t)report->npart, e = (size_t)report->nend, z = (size_t)report->nz;
    double *memory = pm_arena_array(arena, 7 * p + 4 * e + z, sizeof *memory);
    int64_t *counts = pm_arena_array(arena, 3 * p, sizeof *counts);
    if (memory == NULL || counts == NULL) {
        return pm_fail(PM_ENOMEM, "%s: out of memory for a report",
                       scene->process[process_id].name);
    }
    double **const of_part[] = {
        &report->energy,       &report->entropy,           &report->bulk_energy,
        &report->bulk_entropy, &report->bulk_energy_gross, &report->bulk_entropy_gross,
        &report->error};
    double **const of_end[] = {&report->energy_flux, &report->entropy_flux, &report->energy_gross,
                               &report->entropy_gross};
    for (int i = 0; i < 7; ++i, memory += p) {
        *of_part[i] = memory;
    }
    for (int i = 0; i < 4; ++i, memory += e) {
        *of_end[i] = memory;
    }
    report->z = memory;
    report->evaluated = counts;
    report->skipped = counts + p;
    report->outside = counts + 2 * p;
    return PM_OK;
}

pm_status pm_reporter_init(pm_reporter *reporter, pm_arena *arena, const pm_system *system,
                           int process_id, pm_transport *transport, int64_t instance, int more) {
    pm_reporter *r = reporter;
    const pm_scene *scene = system->scene;
    r->scene = scene;
    r->process = &scene->process[process_id];
    r->transport = transport;
    count_numbers(scene, process_id, &r->npart, &r->nend, &r->nz);
    r->capacity = most_rows(scene, process_id);
    PM_TRY(pm_channel_process(r->sent.channel, scene, "REPORT", process_id));
    PM_TRY(pm_report_message_alloc(&r->done, arena, scene, process_id));
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

pm_status pm_reporter_add_step(pm_reporter *reporter, const portmet_report_t *head,
                               const pm_process_subsystems *subsystems, bool with_state) {
    pm_reporter *r = reporter;
    portmet_report_t *m = &r->done;
    PM_TRY(check_books(r, head->step, subsystems));
    if (r->rows == 0) {
        m->session = head->session;
        m->coordinator = head->coordinator;
        m->step = head->step;
        m->time = head->time;
        m->nz = 0;
    }
    int end = r->rows * r->nend;
    for (int i = 0; i < subsystems->count; ++i) {
        const pm_books books = pm_local_subsystems_books(subsystems->local, i);
        end = add_books(m, r->rows * r->npart + i, end, &books);
        if (with_state) {
            const int nz = r->scene->subsystem[r->process->subsystem[i]].layout.nz;
            pm_local_subsystems_state(subsystems->local, i, m->z + m->nz);
            m->nz += nz;
        }
    }
    r->rows += 1;
    return r->rows < r->capacity ? PM_OK : pm_reporter_flush(r);
}

pm_status pm_reporter_flush(pm_reporter *reporter) {
    pm_reporter *r = reporter;
    portmet_report_t *m = &r->done;
    if (r->rows == 0) {
        return PM_OK;
    }
    m->npart = r->rows * r->npart;
    m->nend = r->rows * r->nend;
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
