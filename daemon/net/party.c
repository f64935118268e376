// Decodes what is meant for all, counts what is dropped.
#include "net/party.h"

#include <stdio.h>

#include "store/channel.h"

void pm_party_count(pm_party *party, pm_drop drop) {
    party->drops.count[drop] += 1;
}

// --- receiving ---

static void on_hello(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_party *party = context;
    portmet_hello_t hello;
    const pm_drop drop = pm_hello_decode(&hello, data, size);
    pm_party_count(party, drop == PM_KEEP ? party->ears->hello(party->context, &hello) : drop);
}

static void on_command(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_party *party = context;
    portmet_command_t command;
    const pm_drop drop = pm_command_decode(&command, data, size);
    pm_party_count(party, drop == PM_KEEP ? party->ears->command(party->context, &command) : drop);
}

static void on_request(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_party *party = context;
    portmet_request_t request;
    const pm_drop drop = pm_request_decode(&request, data, size);
    pm_party_count(party, drop == PM_KEEP ? party->ears->request(party->context, &request) : drop);
}

pm_status pm_party_open(pm_party *party, const pm_party_ears *ears, void *context, const char *name,
                        int64_t asked, bool keeps_checkpoints) {
    const pm_scene *scene = party->system->scene;
    pm_transport *transport = party->transport;
    char own_address[PM_CHANNEL_SIZE];
    party->ears = ears;
    party->context = context;
    pm_waiting_init(&party->waiting, scene->nprocess);
    PM_TRY(pm_identity_init(&party->identity, party->system, name, asked, keeps_checkpoints,
                            transport));
    PM_TRY(pm_channel_scene(party->tick_channel, scene, "TICK"));
    PM_TRY(pm_channel_scene(party->request_channel, scene, "REQUEST"));
    PM_TRY(pm_channel_request(party->tick_address, scene, ""));
    PM_TRY(pm_channel_request(own_address, scene, name));
    PM_TRY(pm_transport_subscribe(transport, party->identity.hello_channel, on_hello, party));
    PM_TRY(pm_transport_subscribe(transport, party->identity.command_channel, on_command, party));
    PM_TRY(pm_transport_subscribe(transport, own_address, on_request, party));
    return pm_transport_subscribe(transport, party->request_channel, on_request, party);
}

pm_status pm_party_overhear(pm_party *party, const char *address) {
    return pm_transport_subscribe(party->transport, address, on_request, party);
}

// --- asking ---

pm_status pm_party_request(const pm_party *party, const char *address, const char *channel,
                           int64_t step, int round) {
    const portmet_request_t message = {
        .session = party->session,
        .sender = party->identity.hello.sender,
        .instance = party->identity.hello.instance,
        .attempt = party->attempt,
        .channel = (char *)channel,
        .step = step,
        .round = round,
    };
    // Names of processes are shorter than the channels that contain them.
    unsigned char data[96 + 2 * PM_CHANNEL_SIZE];
    const size_t size = pm_request_encode(&message, data, sizeof data);
    const char *to = pm_waiting_long(&party->waiting) ? party->request_channel : address;
    return pm_transport_publish(party->transport, to, data, size);
}

// --- the end ---

void pm_party_end(pm_party *party, pm_status status, const char *message) {
    party->status = status;
    snprintf(party->message, sizeof party->message, "%s", message);
}

pm_status pm_party_result(const pm_party *party) {
    return party->status == PM_OK ? PM_OK : pm_fail(party->status, "%s", party->message);
}

pm_status pm_party_code(int8_t code) {
    const bool known = code >= PM_EUSAGE && code <= PM_EINTERRUPTED;
    return known ? (pm_status)code : PM_ENET;
}
