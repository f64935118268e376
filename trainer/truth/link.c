// Reads links and distributions.
#include "truth/link.h"

#include "truth/numbers.h"

pm_status pm_truth_link(pm_yaml map, pm_chain_link *link) {
    const double tiny = 1e-12, huge = 1e12;
    PM_TRY(pm_truth_number(map, "mass", tiny, huge, &link->mass));
    PM_TRY(pm_truth_number(map, "C", 0, huge, &link->C));
    PM_TRY(pm_truth_number(map, "l0", tiny, huge, &link->l0));
    PM_TRY(pm_truth_number(map, "b", 0, huge, &link->b));
    return pm_truth_number(map, "c", tiny, huge, &link->c);
}

pm_status pm_truth_spread(pm_yaml map, const char *key, int count, pm_arena *arena,
                          pm_spread *result) {
    static const char *const keys[] = {"mean", "deviation", NULL};
    pm_yaml spread;
    PM_TRY(pm_yaml_require(map, key, &spread));
    PM_TRY(pm_yaml_allow(spread, keys));
    PM_TRY(pm_truth_numbers(spread, "mean", count, arena, result->mean));
    return pm_truth_numbers(spread, "deviation", count, arena, result->deviation);
}

double pm_spread_draw(pm_rng *rng, const pm_spread *s, int i) {
    return s->mean[i] + s->deviation[i] * pm_rng_normal(rng);
}
