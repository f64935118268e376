// What the simulators of thermoelastic links read alike: a link's constants, and normal variables
// that initial states are drawn from.
#ifndef PM_TRAINER_TRUTH_LINK_H
#define PM_TRAINER_TRUTH_LINK_H

#include "base/rng.h"
#include "store/yaml.h"
#include "truth/chain.h"

// A normal variable; two for a vector.
typedef struct pm_spread {
    double mean[2], deviation[2];
} pm_spread;

// `mass`, `C`, `l0`, `b` and `c` of a link. PM_ECONFIG.
pm_status pm_truth_link(pm_yaml map, pm_chain_link *link);
// The map {mean, deviation} under `key`, of `count` components. PM_ECONFIG, PM_ENOMEM.
pm_status pm_truth_spread(pm_yaml map, const char *key, int count, pm_arena *arena,
                          pm_spread *result);

// Component i of the variable.
double pm_spread_draw(pm_rng *rng, const pm_spread *s, int i);

#endif
