// Reads the settings that all simulators of thermoelastic links share: the constants of a link, and
// the normal distributions from which initial states are drawn.
#ifndef PM_TRAINER_TRUTH_LINK_H
#define PM_TRAINER_TRUTH_LINK_H

#include "base/rng.h"
#include "store/yaml.h"
#include "truth/chain.h"

// The mean and the standard deviation of a normal random variable, or of two independent ones.
typedef struct pm_spread {
    double mean[2], deviation[2];
} pm_spread;

// Reads `mass`, `C`, `l0`, `b` and `c` of a link (chain.h). PM_ECONFIG.
pm_status pm_truth_link(pm_yaml map, pm_chain_link *link);
// Reads the map {mean, deviation} under `key`, of `count` components (1 or 2). PM_ECONFIG,
// PM_ENOMEM.
pm_status pm_truth_spread(pm_yaml map, const char *key, int count, pm_arena *arena,
                          pm_spread *result);

// Draws component i of the variable.
double pm_spread_draw(pm_rng *rng, const pm_spread *s, int i);

#endif
