// SPDX-License-Identifier: MIT
// A controller in C that swings the pivot of configs/live_double_pendulum.yaml to and fro:
//
//     cc -o swing swing.c portmet_tick_t.c portmet_input_t.c $(pkg-config --cflags --libs lcm) -lm
//
// `lcm-gen -c portmet.lcm` writes the two generated files. Every tick says how many steps the run
// has been granted; the controller answers with the values of the step that comes next. The run
// repeats its tick as long as it waits, so that a lost message, or a controller that starts late or
// anew, does no harm.
#include <lcm/lcm.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

#include "portmet_input_t.h"
#include "portmet_tick_t.h"

#define AMPLITUDE 0.2 // m
#define FREQUENCY 2.0 // rad/s

static void answer(const lcm_recv_buf_t *buffer, const char *channel, const portmet_tick_t *tick,
                   void *context) {
    (void)buffer;
    (void)channel;
    const double time = (double)tick->granted * tick->dt;
    double velocity[2] = {AMPLITUDE * FREQUENCY * cos(FREQUENCY * time), 0}; // m/s
    const portmet_input_t input = {.step = tick->granted, .n = 2, .value = velocity};
    portmet_input_t_publish(context, "PIVOT", &input);
}

int main(int argc, char **argv) {
    lcm_t *lcm = lcm_create(argc > 1 ? argv[1] : NULL);
    if (lcm == NULL) {
        fputs("swing: no LCM\n", stderr);
        return EXIT_FAILURE;
    }
    portmet_tick_t_subscribe(lcm, "live_double_pendulum_TICK", answer, lcm);
    while (lcm_handle(lcm) == 0) {
    }
    lcm_destroy(lcm);
    return EXIT_SUCCESS;
}
