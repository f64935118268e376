// SPDX-License-Identifier: MIT
// A listener in plain LCM: prints the fluxes of every step of a running scene, and the ledger.
//
//     lcm-gen -c portmet.lcm
//     cc -o listen listen.c portmet_*.c $(pkg-config --cflags --libs lcm)
//     ./listen double_pendulum
//
// listen.py does the same in Python.
#include "portmet_command_t.h"
#include "portmet_flux_t.h"
#include "portmet_ledger_t.h"
#include <inttypes.h>
#include <lcm/lcm.h>
#include <stdio.h>

static void on_flux(const lcm_recv_buf_t *buffer, const char *channel, const portmet_flux_t *flux,
                    void *context) {
    (void)buffer, (void)context;
    if (flux->round == 0) { // the fluxes in a message are means over the step before
        for (int i = 0; i < flux->nend; ++i) {
            printf("%s step %" PRId64 ": end %d: %+.6e W %+.6e W/K\n", channel, flux->step, i,
                   flux->energy_flux[i], flux->entropy_flux[i]);
        }
    }
}

static void on_ledger(const lcm_recv_buf_t *buffer, const char *channel,
                      const portmet_ledger_t *ledger, void *context) {
    (void)buffer, (void)context;
    printf("%s step %" PRId64 ": %.9f J %.9f J/K, %" PRId64 " violations\n", channel, ledger->step,
           ledger->energy, ledger->entropy, ledger->violations);
}

static void on_command(const lcm_recv_buf_t *buffer, const char *channel,
                       const portmet_command_t *command, void *context) {
    (void)buffer, (void)channel;
    *(int *)context = command->kind != PORTMET_COMMAND_T_REFUSE; // END or ABORT
}

int main(int argc, char **argv) {
    char channel[64];
    int over = 0;
    lcm_t *lcm = lcm_create("udpm://239.255.76.67:7667?ttl=0&recv_buf_size=4194304");
    if (argc != 2 || lcm == NULL) {
        fprintf(stderr, "usage: listen SCENE (in a network with a multicast route)\n");
        return 1;
    }
    snprintf(channel, sizeof channel, "%s_FLUX_.*", argv[1]); // a regular expression
    portmet_flux_t_subscription_t *fluxes = portmet_flux_t_subscribe(lcm, channel, on_flux, NULL);
    portmet_flux_t_subscription_set_queue_capacity(fluxes, 0); // liblcm's 30 messages lose some
    snprintf(channel, sizeof channel, "%s_LEDGER", argv[1]);
    portmet_ledger_t_subscribe(lcm, channel, on_ledger, NULL);
    snprintf(channel, sizeof channel, "%s_COMMAND", argv[1]);
    portmet_command_t_subscribe(lcm, channel, on_command, &over);
    while (!over && lcm_handle_timeout(lcm, 10000) > 0) { // 10 s without a message end it, too
    }
    lcm_destroy(lcm);
    return 0;
}
