// A process's reports, taken apart.
#include "net/member.h"

#include <string.h>

#include "net/flux_link.h"
#include "net/reporter.h"
#include "store/channel.h"

// The ends of ports in the order of reports: by subsystem, then by port, then the world's ends of
// the subsystem's loads.
static pm_status list_ends(pm_member *member, pm_arena *arena) {
    const pm_scene *scene = member->scene;
    const pm_scene_process *process = &scene->process[member->id];
    member->end = pm_arena_array(arena, 2 * (size_t)scene->nport, sizeof *member->end);
    if (member->end == NULL) {
        return pm_fail(PM_ENOMEM, "coordinator: out of memory for %s", member->name);
    }
    for (int i = 0; i < process->count; ++i) {
        const int first = member->nend;
        for (int k = 0; k < 2 * scene->nport; ++k) {
            if (scene->port[k / 2].subsystem[k % 2] == process->subsystem[i]) {
                member->end[member->nend++] = k;
            }
        }
        for (int k = first, count = member->nend; k < count; ++k) {
            const int other = member->end[k] ^ 1;
            if (scene->port[other / 2].load[other % 2] >= 0) {
                member->end[member->nend++] = other;
            }
        }
        member->nz += scene->subsystem[process->subsystem[i]].layout.nz;
    }
    return PM_OK;
}

pm_status pm_member_init(pm_member *member, pm_arena *arena, const pm_scene *scene,
                         int process_id) {
    member->id = process_id;
    member->name = scene->process[process_id].name;
    member->scene = scene;
    member->done = -1;
    PM_TRY(pm_channel_process(member->channel, scene, "REPORT", process_id));
    PM_TRY(pm_channel_process(member->flux_channel, scene, "FLUX", process_id));
    PM_TRY(pm_channel_request(member->address, scene, member->name));
    PM_TRY(list_ends(member, arena));
    PM_TRY(pm_flux_make(&member->shown, arena, scene, process_id));
    PM_TRY(pm_report_make(&member->scratch, arena, scene, process_id));
    member->most_part = member->scratch.npart;
    member->most_end = member->scratch.nend;
    member->most_z = member->scratch.nz;
    return PM_OK;
}

int pm_member_rows(const pm_member *member) {
    return member->scratch.npart / member->scene->process[member->id].count;
}

pm_drop pm_member_decode(pm_member *member, const void *data, size_t size, bool with_state) {
    portmet_report_t *r = &member->scratch;
    r->npart = member->most_part;
    r->nend = member->most_end;
    r->nz = member->most_z;
    const pm_drop drop = pm_report_decode(r, data, size);
    if (drop != PM_KEEP || r->kind != PORTMET_REPORT_T_DONE) {
        return drop;
    }
    const int rows = pm_member_rows(member);
    const bool whole = rows > 0 && r->npart == rows * member->scene->process[member->id].count &&
                       r->nend == rows * member->nend &&
                       r->nz == (with_state ? rows * member->nz : 0);
    return whole ? PM_KEEP : PM_DROP_COUNT;
}

void pm_member_fill(const pm_member *member, int row, pm_sample *sample) {
    const portmet_report_t *r = &member->scratch;
    const pm_scene_process *process = &member->scene->process[member->id];
    const double *z = r->nz > 0 ? r->z + row * member->nz : NULL;
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
            const pm_scene_subsystem *subsystem = &member->scene->subsystem[i];
            memcpy(sample->z + subsystem->first, z, (size_t)subsystem->layout.nz * sizeof *z);
            z += subsystem->layout.nz;
        }
    }
    for (int k = 0; k < member->nend; ++k) {
        const int from = row * member->nend + k;
        sample->flux[member->end[k] / 2][member->end[k] % 2] = (pm_flux){
            .energy = r->energy_flux[from],
            .entropy = r->entropy_flux[from],
            .energy_gross = r->energy_gross[from],
            .entropy_gross = r->entropy_gross[from],
        };
    }
}
