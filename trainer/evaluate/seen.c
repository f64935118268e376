// Compares the digests of trajectories with those in the weights. The name of the file and the
// order of its trajectories do not matter.
#include "evaluate/seen.h"

static bool has_seen(const pm_provenance *provenance, uint64_t digest) {
    for (int i = 0; i < provenance->nseen; ++i) {
        if (provenance->seen[i] == digest) {
            return true;
        }
    }
    return false;
}

int pm_seen_mark(const pm_system *system, const pm_dataset *dataset, bool *seen) {
    const pm_scene *scene = system->scene;
    bool known = false;
    int count = 0;
    for (int i = 0; i < dataset->ntrajectory; ++i) {
        const uint64_t digest = pm_dataset_digest(dataset, i);
        seen[i] = false;
        for (int k = 0; k < scene->nsubsystem + scene->nport; ++k) {
            const pm_provenance *p = k < scene->nsubsystem
                                         ? system->part_provenance[k]
                                         : system->port_provenance[k - scene->nsubsystem];
            known = known || p->nseen > 0;
            seen[i] = seen[i] || has_seen(p, digest);
        }
        count += seen[i];
    }
    return known ? count : -1;
}
