// Reads numbers at fixed places of messages, and keeps them until their step is granted.
#include "lockstep/live_inputs.h"

#include <endian.h>
#include <math.h>
#include <string.h>

#include "portmet_input_t.h"

// --- messages ---

static uint64_t read_bits(const unsigned char *at, int size) {
    uint64_t bits = 0;
    for (int i = 0; i < size; ++i) {
        bits = bits << 8 | at[i];
    }
    return bits;
}

static int64_t read_integer(const unsigned char *message, const pm_live_place *place) {
    const int unused = 64 - 8 * place->size;
    const uint64_t bits = read_bits(message + place->offset, place->size) << unused;
    return (int64_t)bits >> unused;
}

static double read_number(const unsigned char *message, const pm_live_place *place) {
    const uint64_t bits = read_bits(message + place->offset, place->size);
    double number;
    float single;
    const uint32_t low = (uint32_t)bits;
    switch (place->type) {
    case PM_LIVE_DOUBLE:
        memcpy(&number, &bits, sizeof number);
        return number;
    case PM_LIVE_FLOAT:
        memcpy(&single, &low, sizeof single);
        return (double)single;
    case PM_LIVE_INTEGER:
        return (double)read_integer(message, place);
    default:
        return (double)bits;
    }
}

// Returns the reason for which a message is not of the type that the scene expects.
static pm_drop check_form(const pm_scene_live_input *input, const unsigned char *data,
                          size_t size) {
    if (size < PM_LIVE_HEAD) {
        return PM_DROP_LENGTH;
    }
    if (!input->own_type) {
        return size < input->least_size ? PM_DROP_LENGTH : PM_KEEP;
    }
    if (read_bits(data, PM_LIVE_HEAD) != (uint64_t)__portmet_input_t_get_hash()) {
        return PM_DROP_TYPE;
    }
    if (size != input->least_size) {
        return PM_DROP_LENGTH;
    }
    return read_bits(data + PM_LIVE_HEAD + 8, 4) == (uint64_t)input->count ? PM_KEEP
                                                                           : PM_DROP_COUNT;
}

// Compares a message with the values that are known already of its step. Others come from another
// program, or from one that was started again, and the first ones hold.
static pm_drop compare(pm_live_channel *channel, const unsigned char *data, const double *known,
                       int64_t step) {
    const pm_scene_live_input *input = channel->input;
    for (int i = 0; i < input->count; ++i) {
        if (read_number(data, &input->place[i]) != known[i]) {
            channel->owner->disputed = input->channel;
            channel->owner->disputed_step = step;
            return PM_DROP_CONFLICT;
        }
    }
    return PM_DROP_REPEATED;
}

// Keeps the numbers of a message for its step, or, if no step waits for a message of its own, as
// the newest ones. A message for a step that is over says nothing of a sender that is alive.
static pm_drop keep(pm_live_channel *channel, const unsigned char *data, size_t size) {
    const pm_scene_live_input *input = channel->input;
    const int64_t next = channel->owner->next;
    PM_TRY_KEEP(check_form(input, data, size));
    const int64_t step = input->waits ? read_integer(data, &input->step) : 0;
    const int64_t slot = input->waits ? step % PM_LIVE_AHEAD : 0;
    if (input->waits && step < next) {
        return step != next - 1 || step < 0
                   ? PM_DROP_REPEATED
                   : compare(channel, data, channel->owner->taken[step % 2] + input->first, step);
    }
    if (input->waits && step >= next + PM_LIVE_AHEAD) {
        return PM_DROP_RANGE;
    }
    for (int i = 0; i < input->count; ++i) {
        if (!isfinite(read_number(data, &input->place[i]))) {
            return PM_DROP_NUMBER;
        }
    }
    channel->fresh = true;
    channel->any = true;
    if (input->waits && channel->step[slot] == step) {
        return compare(channel, data, channel->value + slot * input->count, step);
    }
    channel->step[slot] = step;
    for (int i = 0; i < input->count; ++i) {
        channel->value[slot * input->count + i] = read_number(data, &input->place[i]);
    }
    return PM_KEEP;
}

static void on_message(void *context, const char *name, const void *data, size_t size) {
    (void)name;
    pm_live_channel *channel = context;
    channel->owner->drops->count[keep(channel, data, size)] += 1;
}

// --- opening ---

pm_status pm_live_inputs_open(pm_live_inputs *live, const pm_scene *scene, pm_arena *arena,
                              pm_transport *transport, const double *replay, int64_t replayed,
                              pm_drops *drops) {
    const size_t n = (size_t)scene->network.nlive;
    *live =
        (pm_live_inputs){.scene = scene, .replay = replay, .replayed = replayed, .drops = drops};
    live->channel =
        pm_arena_array(arena, (size_t)scene->network.nlive_input, sizeof *live->channel);
    live->taken[0] = pm_arena_array(arena, n, sizeof(double));
    live->taken[1] = pm_arena_array(arena, n, sizeof(double));
    PM_TRY(pm_arena_status(arena, "live inputs"));
    for (int i = 0; i < scene->network.nlive_input; ++i) {
        const pm_scene_live_input *input = &scene->network.live_input[i];
        pm_live_channel *channel = &live->channel[i];
        *channel = (pm_live_channel){.owner = live, .input = input};
        channel->step = pm_arena_array(arena, PM_LIVE_AHEAD, sizeof *channel->step);
        channel->value =
            pm_arena_array(arena, PM_LIVE_AHEAD * (size_t)input->count, sizeof *channel->value);
        channel->given = pm_arena_array(arena, (size_t)input->count, sizeof *channel->given);
        PM_TRY(pm_arena_status(arena, "live inputs"));
        if (replay == NULL && transport != NULL) {
            PM_TRY(pm_transport_subscribe(transport, input->channel, on_message, channel));
        }
    }
    pm_live_inputs_set(live, NULL, false);
    return PM_OK;
}

void pm_live_inputs_set(pm_live_inputs *live, const double *values, bool kept) {
    live->next = values == NULL ? 0 : live->next;
    for (int i = 0; i < live->scene->network.nlive_input; ++i) {
        pm_live_channel *channel = &live->channel[i];
        const pm_scene_live_input *input = channel->input;
        const size_t size = (size_t)input->count * sizeof *values;
        if (values == NULL) {
            channel->any = channel->fresh = false;
            memset(channel->step, -1, PM_LIVE_AHEAD * sizeof *channel->step);
            memcpy(channel->value, input->start, size);
            memcpy(live->taken[1] + input->first, input->start, size);
        } else if (input->waits) { // messages for later steps still count
            memcpy(channel->given, values + input->first, size);
            channel->step[live->next % PM_LIVE_AHEAD] = -1;
        } else {
            memcpy(channel->value, values + input->first, size);
        }
        channel->set = values != NULL && !(kept && input->waits);
    }
}

// --- steps ---

pm_status pm_live_inputs_check(pm_live_inputs *live, double now) {
    if (live->replay != NULL) {
        return live->next < live->replayed
                   ? PM_OK
                   : pm_fail(PM_EDATA, "the recording that is replayed ends after step %lld",
                             (long long)live->replayed);
    }
    for (int i = 0; i < live->scene->network.nlive_input; ++i) {
        pm_live_channel *channel = &live->channel[i];
        channel->heard = channel->fresh ? now : channel->heard;
        channel->fresh = false;
        if (channel->any && now - channel->heard > channel->input->age) {
            return pm_fail(PM_ETIMEOUT, "no message on %s for %.3g s, in step %lld",
                           channel->input->channel, now - channel->heard, (long long)live->next);
        }
    }
    return PM_OK;
}

const char *pm_live_inputs_awaited(const pm_live_inputs *live) {
    for (int i = 0; i < live->scene->network.nlive_input && live->replay == NULL; ++i) {
        const pm_live_channel *channel = &live->channel[i];
        const bool here = channel->input->waits
                              ? channel->step[live->next % PM_LIVE_AHEAD] == live->next
                              : channel->any || channel->input->starts;
        if (!here && !channel->set) {
            return channel->input->channel;
        }
    }
    return NULL;
}

void pm_live_inputs_take(pm_live_inputs *live) {
    double *to = live->taken[live->next % 2];
    if (live->replay != NULL) {
        memcpy(to, live->replay + (ptrdiff_t)live->next * live->scene->network.nlive,
               (size_t)live->scene->network.nlive * sizeof *to);
    }
    for (int i = 0; i < live->scene->network.nlive_input && live->replay == NULL; ++i) {
        const pm_live_channel *channel = &live->channel[i];
        const pm_scene_live_input *input = channel->input;
        const int64_t slot = input->waits ? live->next % PM_LIVE_AHEAD : 0;
        const bool given = input->waits && channel->step[slot] != live->next;
        memcpy(to + input->first, given ? channel->given : channel->value + slot * input->count,
               (size_t)input->count * sizeof *to);
    }
    live->next += 1;
}

const double *pm_live_inputs_values(const pm_live_inputs *live, int64_t step) {
    return live->taken[(step + 2) % 2];
}
