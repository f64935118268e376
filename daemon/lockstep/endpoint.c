// Decodes the messages that all processes receive, and counts those that are dropped.
#include "lockstep/endpoint.h"

#include <stdio.h>

#include "transport/channel.h"

void pm_endpoint_count(pm_endpoint *endpoint, pm_drop drop) {
    endpoint->drops.count[drop] += 1;
}

void pm_endpoint_look(pm_endpoint *endpoint, double clock) {
    endpoint->now = pm_presence_look(&endpoint->presence, clock);
}

double pm_endpoint_clock(const pm_endpoint *endpoint, double time) {
    return time + endpoint->presence.absent;
}

// --- receiving ---

static void on_hello(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_endpoint *endpoint = context;
    portmet_hello_t hello;
    const pm_drop drop = pm_hello_decode(&hello, data, size);
    pm_endpoint_count(
        endpoint, drop == PM_KEEP ? endpoint->handlers->hello(endpoint->context, &hello) : drop);
}

static void on_command(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_endpoint *endpoint = context;
    portmet_command_t command;
    const pm_drop drop = pm_command_decode(&command, data, size);
    pm_endpoint_count(endpoint, drop == PM_KEEP
                                    ? endpoint->handlers->command(endpoint->context, &command)
                                    : drop);
}

static void on_request(void *context, const char *channel, const void *data, size_t size) {
    (void)channel;
    pm_endpoint *endpoint = context;
    portmet_request_t request;
    const pm_drop drop = pm_request_decode(&request, data, size);
    pm_endpoint_count(endpoint, drop == PM_KEEP
                                    ? endpoint->handlers->request(endpoint->context, &request)
                                    : drop);
}

pm_status pm_endpoint_open(pm_endpoint *endpoint, const pm_handlers *handlers, void *context,
                           const char *name, int64_t asked, bool keeps_checkpoints) {
    const pm_scene *scene = endpoint->system->scene;
    pm_transport *transport = endpoint->transport;
    char own_address[PM_CHANNEL_SIZE], coordinators[PM_CHANNEL_SIZE];
    endpoint->handlers = handlers;
    endpoint->context = context;
    pm_waiting_init(&endpoint->waiting, scene->nprocess, name[0] == 0 ? 1 : scene->nprocess);
    PM_TRY(pm_identity_init(&endpoint->identity, endpoint->system, name, asked, keeps_checkpoints,
                            transport));
    PM_TRY(pm_channel_scene(endpoint->tick_channel, scene, "TICK"));
    PM_TRY(pm_channel_scene(endpoint->request_channel, scene, "REQUEST"));
    PM_TRY(pm_channel_request(endpoint->coordinator_address, scene, ""));
    PM_TRY(pm_channel_request(own_address, scene, name));
    PM_TRY(pm_channel_hello(coordinators, scene, ""));
    PM_TRY(pm_transport_subscribe(transport, coordinators, on_hello, endpoint));
    if (name[0] != 0) { // rivals
        PM_TRY(pm_transport_subscribe(transport, endpoint->identity.hello_channel, on_hello,
                                      endpoint));
    }
    PM_TRY(pm_transport_subscribe(transport, endpoint->identity.command_channel, on_command,
                                  endpoint));
    PM_TRY(pm_transport_subscribe(transport, own_address, on_request, endpoint));
    return pm_transport_subscribe(transport, endpoint->request_channel, on_request, endpoint);
}

pm_status pm_endpoint_listen_to(pm_endpoint *endpoint, const char *name, const char *address) {
    char hellos[PM_CHANNEL_SIZE];
    PM_TRY(pm_channel_hello(hellos, endpoint->system->scene, name));
    PM_TRY(pm_transport_subscribe(endpoint->transport, hellos, on_hello, endpoint));
    return pm_transport_subscribe(endpoint->transport, address, on_request, endpoint);
}

// --- requests ---

pm_status pm_endpoint_request(pm_endpoint *endpoint, const char *address, const char *channel,
                              int64_t step, int round) {
    const portmet_request_t message = {
        .session = endpoint->session,
        .sender = endpoint->identity.hello.sender,
        .instance = endpoint->identity.hello.instance,
        .attempt = endpoint->attempt,
        .channel = (char *)channel,
        .step = step,
        .round = round,
    };
    const double pause = PM_ENDPOINT_ALL_ASKED * endpoint->system->scene->nprocess;
    // Names of processes are shorter than the channels that contain them.
    unsigned char data[96 + 2 * PM_CHANNEL_SIZE];
    const size_t size = pm_request_encode(&message, data, sizeof data);
    const bool all =
        pm_waiting_is_long(&endpoint->waiting) && endpoint->now >= endpoint->all_asked_at + pause;
    const char *to = all ? endpoint->request_channel : address;
    endpoint->all_asked_at = all ? endpoint->now : endpoint->all_asked_at;
    pm_waiting_note_requests(&endpoint->waiting, 1);
    return pm_transport_publish(endpoint->transport, to, data, size);
}

// --- the end ---

void pm_endpoint_end(pm_endpoint *endpoint, pm_status status, const char *message) {
    endpoint->status = status;
    snprintf(endpoint->message, sizeof endpoint->message, "%s", message);
}

pm_status pm_endpoint_result(const pm_endpoint *endpoint) {
    return endpoint->status == PM_OK ? PM_OK : pm_fail(endpoint->status, "%s", endpoint->message);
}

pm_status pm_endpoint_code(int8_t code) {
    const bool known = code >= PM_EUSAGE && code <= PM_EINTERRUPTED;
    return known ? (pm_status)code : PM_ENET;
}
