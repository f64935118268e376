// The rounds of the race.
#include "optimise/successive_halving.h"

#include <stdlib.h>

#include "base/arena.h"

typedef struct candidate {
    int id;
    double score;
} candidate;

// Compares candidates by score, then by number, so that the order is unique.
static int compare(const void *a, const void *b) {
    const candidate *x = a, *y = b;
    return x->score != y->score ? (x->score < y->score ? -1 : 1) : x->id - y->id;
}

pm_status pm_successive_halving_run(const pm_successive_halving *how, int *best, double *score) {
    pm_arena arena = {0};
    candidate *list = pm_arena_array(&arena, (size_t)how->count, sizeof *list);
    pm_status status;
    PM_TRY_DONE(pm_arena_status(&arena, "%d candidates", how->count));
    for (int i = 0; i < how->count; ++i) {
        list[i].id = i;
    }
    int iterations = how->iterations;
    for (int left = how->count; left > 1; left = (left + 1) / 2) {
        for (int i = 0; i < left; ++i) {
            PM_TRY_DONE(how->advance(how->context, list[i].id, left, iterations, &list[i].score));
        }
        qsort(list, (size_t)left, sizeof *list, compare);
        iterations += iterations / 2;
    }
    *best = list[0].id;
    *score = list[0].score;
done:
    pm_arena_free(&arena);
    return status;
}

int pm_successive_halving_iterations(const pm_successive_halving *how) {
    int sum = 0, iterations = how->iterations;
    for (int left = how->count; left > 1; left = (left + 1) / 2) {
        sum += left * iterations;
        iterations += iterations / 2;
    }
    return sum;
}
