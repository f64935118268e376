// SPDX-License-Identifier: MIT
// A client of `portmetd serve` in plain LCM: begins a run that is held at its start, takes single
// steps, and prints the energy after each.
//
//     lcm-gen -c portmet.lcm
//     cc -o advance advance.c portmet_control*.c $(pkg-config --cflags --libs lcm)
//     ./advance double_pendulum 5
//
// advance.py does the same in Python.
#include <inttypes.h>
#include <lcm/lcm.h>
#include <stdio.h>
#include <stdlib.h>
#include <time.h>
#include <unistd.h>

#include "portmet_control_reply_t.h"
#include "portmet_control_t.h"

typedef struct asking {
    lcm_t *lcm;
    char channel[64];
    portmet_control_t request;
    int kind; // of the last reply; -1: none yet
    int64_t step;
    double time, energy;
} asking;

static void on_reply(const lcm_recv_buf_t *buffer, const char *channel,
                     const portmet_control_reply_t *reply, void *context) {
    (void)buffer, (void)channel;
    asking *c = context;
    if (reply->client != c->request.client || reply->nonce != c->request.nonce) {
        return; // to somebody else, or to an earlier request
    }
    c->request.ticket = reply->ticket;
    c->kind = reply->kind;
    c->step = reply->step;
    c->time = reply->time;
    c->energy = reply->energy;
    if (reply->kind == PORTMET_CONTROL_REPLY_T_REFUSED) {
        fprintf(stderr, "refused: %s\n", reply->text);
        exit(reply->code);
    }
}

// Sends a request again and again until it is done, or accepted.
static void ask(asking *c, int kind, int64_t steps) {
    int wait = 20; // ms
    c->request.kind = (int8_t)kind;
    c->request.nonce += 1;
    c->request.steps = steps;
    c->kind = PORTMET_CONTROL_REPLY_T_AGAIN;
    while (c->kind >= PORTMET_CONTROL_REPLY_T_AGAIN) { // or PENDING
        portmet_control_t_publish(c->lcm, c->channel, &c->request);
        if (lcm_handle_timeout(c->lcm, wait) <= 0 && wait < 1000) {
            wait *= 2;
        }
    }
}

int main(int argc, char **argv) {
    const char *scene = argc > 1 ? argv[1] : "double_pendulum";
    const int count = argc > 2 ? atoi(argv[2]) : 5;
    char replies[64];
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    asking c = {.lcm = lcm_create(NULL)};
    if (c.lcm == NULL) {
        return 7;
    }
    snprintf(c.channel, sizeof c.channel, "%s_CONTROL", scene);
    snprintf(replies, sizeof replies, "%s_REPLY", scene);
    c.request.client = ((int64_t)now.tv_sec << 30) + now.tv_nsec + getpid();
    c.request.sender = (char *)"advance";
    c.request.file = (char *)"";
    c.request.held = 1;
    portmet_control_reply_t_subscribe(c.lcm, replies, on_reply, &c);
    ask(&c, PORTMET_CONTROL_T_START, 0);
    for (int i = 0; i < count; ++i) {
        ask(&c, PORTMET_CONTROL_T_ADVANCE, 1);
        printf("step %" PRId64 ", %.1f s: %.9f J\n", c.step, c.time, c.energy);
    }
    ask(&c, PORTMET_CONTROL_T_STOP, 0);
    lcm_destroy(c.lcm);
    return 0;
}
