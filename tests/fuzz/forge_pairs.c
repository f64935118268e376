// forge_pairs each STRIDE: sends single forged messages into running pairs, one in each run, and
// prints what came of it. The messages are the last ones on every channel at several moments of two
// scenes, with 1, 4 or 8 bytes at every place set to a limit of their type or changed a little, so
// that every field of every type is at its limits and beyond; of these only every STRIDE-th is
// sent.
//
// forge_pairs random RUNS: up to eight forged messages in each run, at random.
//
// Ends with 1 if a run stood still for over 2 s, had other bits, or ended without words.
#include <stdlib.h>
#include <string.h>

#include "base/rng.h"
#include "tests/fuzz/forged_pair.h"

#define INPUT 96    // bytes: eight forgeries
#define TYPE_SIZE 8 // bytes: a message begins with its type, which stays

enum { MOMENTS = 14 };

// Turns of the pair before the forgery: the beginning, before and after time has passed, within the
// run, and near its end.
static const int turns[FORGED_SCENES][MOMENTS] = {
    {2, 3, 4, 6, 9, 14, 15, 22, 40, 77, 110, 150, 190, 215},
    {2, 3, 4, 6, 9, 14, 15, 17, 20, 25, 30, 33, 36, 40}};

// Sends every `stride`-th of the forgeries of one message; `count` is the number of those before
// it.
static void forge_message(forgery f, size_t message, long stride, long *count,
                          forged_figures *figures) {
    static const size_t sizes[] = {1, 4, 8};
    for (f.at = TYPE_SIZE; f.at < message; ++f.at) {
        for (int k = 0; k < 3; ++k) {
            f.size = sizes[k];
            for (f.value = 0; f.value < FORGED_VALUES; ++f.value) {
                if ((*count)++ % stride == 0) {
                    forged_pair_run_one(&f, figures);
                }
            }
        }
    }
}

static void forge_each(long stride, forged_figures *figures) {
    long count = 0;
    for (int i = 0; i < FORGED_SCENES * MOMENTS; ++i) {
        for (int channel = 0; channel < FORGED_CHANNELS; ++channel) {
            const forgery f = {
                .scene = i / MOMENTS, .turn = turns[i / MOMENTS][i % MOMENTS], .channel = channel};
            const size_t size = forged_pair_message_size(f.scene, f.turn, channel);
            forge_message(f, size, stride, &count, figures);
        }
        printf("%d of %d moments: %ld messages\n", i + 1, FORGED_SCENES * MOMENTS,
               figures->messages);
        fflush(stdout);
    }
}

static void forge_at_random(long runs, forged_figures *figures) {
    for (long i = 0; i < runs; ++i) {
        uint8_t input[INPUT];
        pm_rng rng;
        pm_rng_init(&rng, 1, (uint64_t)i);
        for (size_t k = 0; k < sizeof input; ++k) {
            input[k] = (uint8_t)pm_rng_below(&rng, 256);
        }
        forged_pair_run_many(input, sizeof input, figures);
    }
}

int main(int argc, char **argv) {
    const long number = argc == 3 ? atol(argv[2]) : 0;
    const bool each = argc == 3 && strcmp(argv[1], "each") == 0;
    if (number < 1 || (!each && strcmp(argv[1], "random") != 0)) {
        fprintf(stderr, "usage: forge_pairs each STRIDE, or forge_pairs random RUNS\n");
        return 2;
    }
    forged_figures figures = {.runs = 0};
    if (each) {
        forge_each(number, &figures);
    } else {
        forge_at_random(number, &figures);
    }
    forged_pair_print(stdout, &figures);
    return figures.messages == 0 || forged_pair_failures(&figures) > 0;
}
