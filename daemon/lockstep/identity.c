// Hellos, answers to hellos, and refusals.
#include "lockstep/identity.h"

#include <inttypes.h>
#include <stdio.h>
#include <string.h>
#include <sys/random.h>
#include <time.h>

#include "lockstep/checkpoint_ring.h"
#include "transport/channel.h"

// A random number that is not 0. The time is good enough if the system has no better one.
static int64_t draw(void) {
    uint64_t bits;
    if (getrandom(&bits, sizeof bits, GRND_NONBLOCK) != (ssize_t)sizeof bits) {
        struct timespec now;
        clock_gettime(CLOCK_REALTIME, &now);
        bits = (uint64_t)now.tv_sec * 1000000000u + (uint64_t)now.tv_nsec;
    }
    return (int64_t)(bits | 1);
}

pm_status pm_identity_init(pm_identity *identity, const pm_system *system, const char *name,
                           int64_t session, bool keeps_checkpoints, pm_transport *transport) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    identity->transport = transport;
    identity->hello = (portmet_hello_t){
        .protocol = pm_protocol(),
        .session = session,
        .instance = (int64_t)now.tv_sec * 1000000000 + now.tv_nsec,
        .nonce = draw(),
        .digest = (int64_t)system->digest,
        .checkpoint = keeps_checkpoints ? pm_checkpoint_ring_interval(system->scene) : 0,
        .sender = (char *)name,
    };
    PM_TRY(pm_channel_hello(identity->hello_channel, system->scene, name));
    return pm_channel_scene(identity->command_channel, system->scene, "COMMAND");
}

pm_status pm_identity_publish_hello(const pm_identity *identity) {
    unsigned char data[96 + PM_CHANNEL_SIZE];
    const size_t size = pm_hello_encode(&identity->hello, data, sizeof data);
    return pm_transport_publish(identity->transport, identity->hello_channel, data, size);
}

bool pm_identity_is_answer(const pm_identity *identity, const int64_t *answer, int count) {
    for (int i = 0; i < count; ++i) {
        if (answer[i] == identity->hello.nonce) {
            return true;
        }
    }
    return false;
}

void pm_identity_renew(pm_identity *identity) {
    identity->answered = identity->hello.nonce;
    identity->hello.nonce = draw();
}

bool pm_identity_is_rival(const pm_identity *identity, const portmet_hello_t *hello) {
    const portmet_hello_t *own = &identity->hello;
    return strcmp(own->sender, hello->sender) == 0 && own->session == hello->session &&
           own->instance != hello->instance;
}

bool pm_identity_is_older(const pm_identity *identity, int64_t instance) {
    return identity->hello.instance < instance;
}

bool pm_identity_mismatch(const pm_identity *identity, const portmet_hello_t *hello, char *reason,
                          size_t size) {
    const portmet_hello_t *own = &identity->hello;
    if (hello->protocol != own->protocol) {
        snprintf(reason, size,
                 "node %s speaks another version of the protocol: %016" PRIx64
                 ", expected %016" PRIx64,
                 hello->sender, (uint64_t)hello->protocol, (uint64_t)own->protocol);
    } else if (hello->digest != own->digest) {
        snprintf(reason, size,
                 "node %s holds another scene, weights or initial state: digest %016" PRIx64
                 ", expected %016" PRIx64,
                 hello->sender, (uint64_t)hello->digest, (uint64_t)own->digest);
    } else if (hello->checkpoint != own->checkpoint) {
        snprintf(reason, size,
                 "node %s keeps a checkpoint every %" PRId64 " steps, the run every %" PRId64
                 " (0: none): give all of them --checkpoint, or none, and the same `lockstep`",
                 hello->sender, hello->checkpoint, own->checkpoint);
    } else {
        return false;
    }
    return true;
}

static pm_status publish_command(const pm_identity *identity, const portmet_command_t *message) {
    unsigned char data[96 + PM_TEXT_MAX];
    const size_t size = pm_command_encode(message, data, sizeof data);
    return pm_transport_publish(identity->transport, identity->command_channel, data, size);
}

pm_status pm_identity_answer(const pm_identity *identity, const portmet_hello_t *hello,
                             int64_t session, int8_t kind, pm_status code, const char *reason) {
    const portmet_command_t message = {
        .session = session,
        .instance = identity->hello.instance,
        .addressee = hello->instance,
        .answer = hello->nonce,
        .kind = kind,
        .code = (int8_t)code,
        .reason = (char *)reason,
    };
    return publish_command(identity, &message);
}

pm_status pm_identity_refuse(const pm_identity *identity, int64_t session, int64_t instance,
                             const char *reason) {
    const portmet_command_t message = {
        .session = session,
        .instance = identity->hello.instance,
        .addressee = instance,
        .kind = PORTMET_COMMAND_T_REFUSE,
        .code = PM_ENET,
        .reason = (char *)reason,
    };
    return publish_command(identity, &message);
}

bool pm_identity_is_addressed(const pm_identity *identity, const portmet_command_t *command) {
    return command->addressee == identity->hello.instance;
}

bool pm_identity_is_proven(const pm_identity *identity, const portmet_command_t *command) {
    return pm_identity_is_addressed(identity, command) && command->answer != 0 &&
           (command->answer == identity->hello.nonce || command->answer == identity->answered);
}
