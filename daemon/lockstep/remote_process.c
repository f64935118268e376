// Decodes a process's reports and distributes their numbers to samples.
#include "lockstep/remote_process.h"

#include <string.h>

#include "base/digest.h"
#include "lockstep/flux_link.h"
#include "lockstep/reporter.h"
#include "transport/channel.h"

// Lists the ends of ports in the order of reports. For each subsystem these are its own ends, by
// port, and then the outside ends of its ports with a boundary input.
static pm_status list_ends(pm_remote_process *remote, pm_arena *arena) {
    const pm_scene *scene = remote->scene;
    const pm_scene_process *process = &scene->process[remote->id];
    const int *first_end = scene->first_end;
    size_t count = 0; // of ends at most
    for (int i = 0; i < process->count; ++i) {
        count +=
            2 * (size_t)(first_end[process->subsystem[i] + 1] - first_end[process->subsystem[i]]);
    }
    remote->end = pm_arena_array(arena, count, sizeof *remote->end);
    if (remote->end == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory for %s", remote->name);
    }
    for (int i = 0; i < process->count; ++i) {
        const int first = remote->nend, id = process->subsystem[i];
        for (int k = first_end[id]; k < first_end[id + 1]; ++k) {
            remote->end[remote->nend++] = scene->end_at[k];
        }
        for (int k = first, last = remote->nend; k < last; ++k) {
            const int other = remote->end[k] ^ 1;
            if (scene->port[other / 2].boundary_input[other % 2] >= 0) {
                remote->end[remote->nend++] = other;
            }
        }
        remote->nz += scene->subsystem[id].layout.nz;
    }
    return PM_OK;
}

pm_status pm_remote_process_init(pm_remote_process *remote, pm_arena *arena, const pm_scene *scene,
                                 int process_id) {
    remote->id = process_id;
    remote->name = scene->process[process_id].name;
    remote->scene = scene;
    remote->done = -1;
    memset(remote->seen_step, -1, sizeof remote->seen_step);
    PM_TRY(pm_channel_process(remote->channel, scene, "REPORT", process_id));
    PM_TRY(pm_channel_process(remote->flux_channel, scene, "FLUX", process_id));
    PM_TRY(pm_channel_request(remote->address, scene, remote->name));
    PM_TRY(list_ends(remote, arena));
    PM_TRY(pm_flux_message_alloc(&remote->flux, arena, scene, process_id));
    PM_TRY(pm_report_message_alloc(&remote->report, arena, scene, process_id));
    remote->most_part = remote->report.npart;
    remote->most_end = remote->report.nend;
    remote->most_z = remote->report.nz;
    return PM_OK;
}

int pm_remote_process_rows(const pm_remote_process *remote) {
    return remote->report.npart / remote->scene->process[remote->id].count;
}

pm_drop pm_remote_process_decode(pm_remote_process *remote, const void *data, size_t size,
                                 bool with_state) {
    portmet_report_t *r = &remote->report;
    r->npart = remote->most_part;
    r->nend = remote->most_end;
    r->nz = remote->most_z;
    const pm_drop drop = pm_report_decode(r, data, size);
    if (drop != PM_KEEP || r->kind != PORTMET_REPORT_T_DONE) {
        return drop;
    }
    const int rows = pm_remote_process_rows(remote);
    const bool whole = rows > 0 && r->npart == rows * remote->scene->process[remote->id].count &&
                       r->nend == rows * remote->nend &&
                       r->nz == (with_state ? rows * remote->nz : 0);
    return whole ? PM_KEEP : PM_DROP_COUNT;
}

// Folds numbers into a digest, eight bytes at a time; quick, as every report passes through it.
static uint64_t fold(uint64_t digest, const void *value, int count) {
    for (int i = 0; i < count; ++i) {
        uint64_t bits;
        memcpy(&bits, (const char *)value + 8 * i, sizeof bits);
        digest = (digest ^ bits) * UINT64_C(0x9e3779b97f4a7c15);
        digest ^= digest >> 32;
    }
    return digest;
}

bool pm_remote_process_agrees(pm_remote_process *remote, int row, int64_t step) {
    const portmet_report_t *r = &remote->report;
    const int part = remote->scene->process[remote->id].count, end = remote->nend;
    const void *const of_part[] = {r->energy,       r->entropy,           r->bulk_energy,
                                   r->bulk_entropy, r->bulk_energy_gross, r->bulk_entropy_gross,
                                   r->evaluated,    r->skipped,           r->outside,
                                   r->error};
    const double *const of_end[] = {r->energy_flux, r->entropy_flux, r->energy_gross,
                                    r->entropy_gross};
    uint64_t digest = PM_DIGEST_INIT;
    for (size_t i = 0; i < sizeof of_part / sizeof of_part[0]; ++i) {
        digest = fold(digest, (const char *)of_part[i] + 8 * row * part, part);
    }
    for (size_t i = 0; i < sizeof of_end / sizeof of_end[0]; ++i) {
        digest = fold(digest, of_end[i] + row * end, end);
    }
    digest = r->nz > 0 ? fold(digest, r->z + row * remote->nz, remote->nz) : digest;
    const int slot = (int)(step % PM_REMOTE_SEEN);
    if (remote->seen_step[slot] == step) {
        return remote->seen[slot] == digest;
    }
    remote->seen_step[slot] = step;
    remote->seen[slot] = digest;
    return true;
}

bool pm_remote_process_is_greeted(const pm_remote_process *remote, int64_t instance) {
    for (int i = 0; i < PM_REMOTE_GREETED; ++i) {
        if (remote->greeted[i] == instance) {
            return true;
        }
    }
    return false;
}

void pm_remote_process_greet(pm_remote_process *remote, int64_t instance) {
    if (!pm_remote_process_is_greeted(remote, instance)) {
        memmove(remote->greeted + 1, remote->greeted,
                (PM_REMOTE_GREETED - 1) * sizeof remote->greeted[0]);
        remote->greeted[0] = instance;
    }
}

void pm_remote_process_fill(const pm_remote_process *remote, int row, pm_sample *sample) {
    const portmet_report_t *r = &remote->report;
    const pm_scene_process *process = &remote->scene->process[remote->id];
    const double *z = r->nz > 0 ? r->z + row * remote->nz : NULL;
    for (int k = 0; k < process->count; ++k) {
        const int i = process->subsystem[k], from = row * process->count + k;
        sample->energy[i] = r->energy[from];
        sample->entropy[i] = r->entropy[from];
        sample->bulk_energy[i] = r->bulk_energy[from];
        sample->bulk_entropy[i] = r->bulk_entropy[from];
        sample->bulk_gross[2 * i] = r->bulk_energy_gross[from];
        sample->bulk_gross[2 * i + 1] = r->bulk_entropy_gross[from];
        sample->evaluated[i] = (long)r->evaluated[from];
        sample->skipped[i] = (long)r->skipped[from];
        sample->outside[i] = (long)r->outside[from];
        sample->error[i] = r->error[from];
        if (z != NULL) {
            const pm_scene_subsystem *subsystem = &remote->scene->subsystem[i];
            memcpy(sample->z + subsystem->first, z, (size_t)subsystem->layout.nz * sizeof *z);
            z += subsystem->layout.nz;
        }
    }
    for (int k = 0; k < remote->nend; ++k) {
        const int from = row * remote->nend + k;
        sample->flux[remote->end[k] / 2][remote->end[k] % 2] = (pm_flux){
            .energy = r->energy_flux[from],
            .entropy = r->entropy_flux[from],
            .energy_gross = r->energy_gross[from],
            .entropy_gross = r->entropy_gross[from],
        };
    }
}
