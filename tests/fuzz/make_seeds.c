// make_seeds DIR: writes the binary seeds of the fuzz targets: a small dataset, fields, a mesh, a
// basis, a recording, a checkpoint, tables, messages and datagrams.
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/rng.h"
#include "bodies/field/field.h"
#include "bodies/modal/basis.h"
#include "lockstep/codec.h"
#include "scene/recording.h"
#include "small_scene.h"
#include "store/dataset.h"
#include "store/snapshot.h"
#include "store/solid_mesh.h"

static pm_status make_dataset(void) {
    static const char *const column[] = {"q", "p"};
    pm_dataset *dataset = NULL;
    PM_TRY(pm_dataset_new(&dataset, 2, 3, 2, 0.5, column));
    pm_status status = pm_dataset_note(dataset, "source", "made for a fuzzer");
    if (status == PM_OK) {
        status = pm_dataset_save(dataset, "dataset.h5");
    }
    pm_dataset_free(dataset);
    return status;
}

static pm_status make_field(const char *path, bool contact) {
    const pm_field_shape shape = {1, 2, 8, 6, 1, contact};
    static const char *const note[][2] = {{"source", "made for a fuzzer"}};
    pm_field *field = NULL;
    PM_TRY(pm_field_new(&field, shape, 0.5, "qx qy qz vx vy vz"));
    const pm_status status = pm_field_save(field, path, 1, note);
    pm_field_free(field);
    return status;
}

static pm_status make_fields(void) {
    PM_TRY(make_field("field.h5", false));
    return make_field("contact.h5", true);
}

// The mesh has one brick, one clamped node and another one that touches.
static pm_status make_mesh(void) {
    static const int brick[8] = {0, 1, 3, 2, 4, 5, 7, 6}, touching = 7;
    static const bool clamped[8] = {true};
    double position[24];
    for (int i = 0; i < 24; ++i) {
        position[i] = i / 3 >> i % 3 & 1;
    }
    const pm_solid_mesh mesh = {8, 1, position, brick, clamped, 1, &touching};
    return pm_solid_mesh_save(&mesh, "mesh.h5");
}

// The recording has three samples.
static pm_status make_recording(void) {
    pm_scene *scene = NULL;
    pm_sample *sample = NULL;
    pm_recording *recording = NULL;
    const double live = 0.5;
    pm_status status;
    PM_TRY_DONE(pm_scene_parse(&scene, SMALL_SCENE, "small.yaml"));
    PM_TRY_DONE(pm_sample_new(&sample, scene));
    PM_TRY_DONE(pm_recording_open(&recording, "recording.h5", scene));
    sample->live = &live;
    for (int i = 0; i < 3; ++i) {
        sample->step = i;
        sample->time = pm_scene_time(scene, i);
        PM_TRY_DONE(pm_recording_append(recording, sample));
    }
    status = pm_recording_close(recording);
    recording = NULL;
done:
    (void)pm_recording_close(recording);
    pm_sample_free(sample);
    pm_scene_free(scene);
    return status;
}

// Of one brick, with one of everything.
static pm_status fill_basis(pm_basis *b) {
    static const int carries[8] = {0, 0, 0, 0, 0, 0, 0, 1};
    b->nbranch = b->nretardation = 1;
    b->tau[0] = b->retardation[0] = b->inertia_time = b->temperature = b->lead_scale[0] = 1;
    b->stiffness[0] = b->stiffness[1] = 1;
    PM_TRY(pm_basis_add_mesh(b, 1));
    for (int i = 0; i < 8; ++i) {
        b->hexahedron[i] = i;
        for (int d = 0; d < 3; ++d) {
            b->position[3 * i + d] = i >> d & 1;
        }
    }
    PM_TRY(pm_basis_add_pattern(b, &b->displacement, 1, 3 * b->nnode));
    PM_TRY(pm_basis_add_pattern(b, &b->stress, 1, PM_BASIS_TENSOR * b->nnode));
    PM_TRY(pm_local_find_sections(&b->local, b->nnode, b->position, &b->arena));
    return pm_local_set_loaded(&b->local, carries, 1, &b->arena);
}

static pm_status make_basis(void) {
    pm_basis *basis = NULL;
    PM_TRY(pm_basis_new(&basis, 8, 2, 1, 1));
    pm_status status = fill_basis(basis);
    if (status == PM_OK) {
        status = pm_basis_save(basis, "basis.h5", "made for a fuzzer");
    }
    pm_basis_free(basis);
    return status;
}

static pm_status make_checkpoint(void) {
    double value[3] = {1, 2, 3};
    const pm_checkpoint_field field[] = {{"theta", 2, value}, {"position", 1, value + 2}};
    return pm_checkpoint_save("fit.checkpoint", "fit", 7, 2, field);
}

static pm_status make_snapshot(void) {
    const double value[3] = {1, 2, 3};
    const pm_snapshot_key key = {.digest = 7, .layout = 9, .count = 3, .owner = "run"};
    return pm_snapshot_save("run.snapshot", &key, 5, value);
}

static pm_status write_seed(const char *path, const void *bytes, size_t size) {
    FILE *file = fopen(path, "wb");
    const bool written = file != NULL && fwrite(bytes, 1, size, file) == size;
    return (file == NULL || fclose(file) == 0) && written
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: cannot be written", path);
}

// Gives a message, whose numbers are zeros, arrays of `count` elements.
static void fill_message(const pm_wire_type *type, void *message, int32_t count) {
    static double array[8] = {1, 2, 3, 4, 5, 6, 7, 8};
    char *m = message, *text = "", *numbers = (char *)array;
    for (int i = 0; i < type->nfield; ++i) {
        const pm_wire_field *f = &type->field[i];
        if (f->kind == PM_WIRE_COUNT) {
            memcpy(m + f->offset, &count, sizeof count);
        } else if (f->kind == PM_WIRE_TEXT) {
            memcpy(m + f->offset, &text, sizeof text);
        } else if (f->kind == PM_WIRE_DOUBLES || f->kind == PM_WIRE_I64S) {
            memcpy(m + f->offset, &numbers, sizeof numbers);
        }
    }
}

// For fuzz_message: the number of the type and the size of its arrays, then the message.
static pm_status make_messages(void) {
    for (int i = 0; pm_wire_types[i] != NULL; ++i) {
        union {
            portmet_control_reply_t reply; // as large as any
            portmet_report_t report;
            portmet_health_t health;
        } message = {.reply = {0}};
        unsigned char bytes[1024] = {(unsigned char)i, 1};
        char path[32];
        fill_message(pm_wire_types[i], &message, 1);
        snprintf(path, sizeof path, "%d.message", i);
        PM_TRY(write_seed(
            path, bytes,
            2 + pm_wire_encode(pm_wire_types[i], &message, bytes + 2, sizeof bytes - 2)));
    }
    return PM_OK;
}

// For fuzz_observer: the length of a message, and the position of its channel among those to which
// the observer listens.
static size_t add_message(unsigned char *at, int to, const pm_wire_type *type, const void *message,
                          size_t capacity) {
    const size_t size = pm_wire_encode(type, message, at + 3, capacity - 3);
    at[0] = (unsigned char)(size >> 8);
    at[1] = (unsigned char)size;
    at[2] = (unsigned char)to;
    return 3 + size;
}

// The messages of a run: a ledger, health, two reports of the body, which has two ends of a port to
// report, and the end.
static pm_status make_heard(void) {
    portmet_ledger_t ledger = {.session = 7};
    portmet_health_t health = {.session = 7};
    portmet_report_t report = {.session = 7, .kind = PORTMET_REPORT_T_DONE};
    portmet_command_t command = {.session = 7, .reason = ""};
    unsigned char bytes[2048] = {0};
    size_t used = 1;
    fill_message(&pm_health_type, &health, 1);
    fill_message(&pm_report_type, &report, 1);
    report.nend = 2;
    report.nz = report.ntally = 0;
    used += add_message(bytes + used, 0, &pm_ledger_type, &ledger, sizeof bytes - used);
    used += add_message(bytes + used, 1, &pm_health_type, &health, sizeof bytes - used);
    for (; report.step < 2; ++report.step) {
        used += add_message(bytes + used, 3, &pm_report_type, &report, sizeof bytes - used);
    }
    used += add_message(bytes + used, 2, &pm_command_type, &command, sizeof bytes - used);
    return write_seed("run.heard", bytes, used);
}

// What a client hears of a service: what is served, and that two requests are done.
static pm_status make_replies(void) {
    static char served[] =
        "{\"dt\":0.5,\"steps\":4,\"subsystems\":[{\"name\":\"body\",\"groups\":[[\"p\",\"kg "
        "m/s\",1],[\"s\",\"J/K\",1]]}],\"ports\":[{\"name\":\"drag\",\"ends\":[\"body\","
        "\"air\"]}],\"inputs\":[[\"v\",\"WIND\",\"m/s\"]]}";
    portmet_control_reply_t reply = {.kind = PORTMET_CONTROL_REPLY_T_DONE};
    unsigned char bytes[4096] = {1};
    size_t used = 1;
    fill_message(&pm_control_reply_type, &reply, 0);
    reply.text = served;
    reply.pages = 1;
    used += add_message(bytes + used, 0, &pm_control_reply_type, &reply, sizeof bytes - used);
    fill_message(&pm_control_reply_type, &reply, 0);
    for (int i = 0; i < 2; ++i) {
        used += add_message(bytes + used, 0, &pm_control_reply_type, &reply, sizeof bytes - used);
    }
    return write_seed("service.heard", bytes, used);
}

// For fuzz_http: how much arrives first, then the bytes of a browser: a request, or a websocket
// that asks for a step.
static pm_status make_requests(void) {
    static const char plain[] = "\xffGET /view.js HTTP/1.1\r\nHost: localhost\r\n\r\n";
    static const char socket[] =
        "\xf2GET / HTTP/1.1\r\nHost: 127.0.0.1:80\r\nOrigin: http://127.0.0.1:80\r\n"
        "Upgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"
        "\x81\x84\1\2\3\4rvft\x89\x80\1\2\3\4\x88\x80\1\2\3\4"; // "step", ping, close
    PM_TRY(write_seed("plain.request", plain, sizeof plain - 1));
    return write_seed("socket.request", socket, sizeof socket - 1);
}

// For fuzz_tables: files of MATLAB 4 and 5 with a matrix, and a log of LCM with two ledgers, after
// a byte for the ending of the name.
static pm_status make_tables(void) {
    static const double q[3] = {1, 2, 4};
    static const int32_t matrix4[] = {0, 3, 1, 0, 2}; // type, rows, columns, imaginary, length
    static const int32_t matrix5[] = {14, 72, 6,           8,   6, 0, 5, 8,
                                      3,  1,  1 | 1 << 16, 'q', 9, 24}; // elements: type and bytes
    unsigned char bytes[1024] = "B";
    size_t used = 1;
    memcpy(bytes + used, matrix4, sizeof matrix4);
    memcpy(bytes + used + sizeof matrix4, "q", 2);
    memcpy(bytes + used + sizeof matrix4 + 2, q, sizeof q);
    PM_TRY(write_seed("four.table", bytes, used + sizeof matrix4 + 2 + sizeof q));
    snprintf((char *)bytes, 130, "B%-124s", "MATLAB 5.0 MAT-file");
    memcpy(bytes + 125, "\0\1IM", 4);
    used = 129;
    memcpy(bytes + used, matrix5, sizeof matrix5);
    memcpy(bytes + used + sizeof matrix5, q, sizeof q);
    PM_TRY(write_seed("five.table", bytes, used + sizeof matrix5 + sizeof q));
    used = 1;
    for (int i = 0; i < 2; ++i) {
        const portmet_ledger_t ledger = {.session = 7, .step = i, .time = i};
        const uint32_t head[7] = {0xeda1da01,
                                  0,
                                  (uint32_t)i,
                                  0,
                                  500000u * (uint32_t)i,
                                  1,
                                  (uint32_t)pm_ledger_size(&ledger)};
        for (size_t k = 0; k < sizeof head; ++k) { // big-endian
            bytes[used++] = (unsigned char)(head[k / 4] >> (24 - 8 * (k % 4)));
        }
        bytes[used++] = 'L';
        used += pm_ledger_encode(&ledger, bytes + used, sizeof bytes - used);
    }
    return write_seed("log.table", bytes, used);
}

// For fuzz_datagram: length and sender, then the datagram.
static size_t add_datagram(unsigned char *at, const void *head, size_t head_size,
                           const char *channel, const void *data, size_t size) {
    const size_t named = channel == NULL ? 0 : strlen(channel) + 1, all = head_size + named + size;
    at[0] = (unsigned char)(all >> 8);
    at[1] = (unsigned char)all;
    at[2] = 0;
    memcpy(at + 3, head, head_size);
    memcpy(at + 3 + head_size, channel == NULL ? "" : channel, named);
    memcpy(at + 3 + head_size + named, data, size);
    return 3 + all;
}

// Eight forgeries: random bytes, to be changed.
static pm_status make_forgery(void) {
    unsigned char bytes[96];
    pm_rng rng;
    pm_rng_init(&rng, 1, 1);
    for (size_t i = 0; i < sizeof bytes; ++i) {
        bytes[i] = (unsigned char)pm_rng_below(&rng, 256);
    }
    return write_seed("pair.forgery", bytes, sizeof bytes);
}

// A tick in one datagram, and a message of 20 bytes in two.
static pm_status make_datagrams(void) {
    static const unsigned char whole[] = "LC02\0\0\0\1";
    static const unsigned char first[] = "LC03\0\0\0\2\0\0\0\x14\0\0\0\0\0\0\0\2";
    static const unsigned char second[] = "LC03\0\0\0\2\0\0\0\x14\0\0\0\x0a\0\1\0\2";
    unsigned char tick[128], bytes[512];
    const size_t size = pm_tick_encode(&(portmet_tick_t){.session = 7}, tick, sizeof tick);
    size_t used = add_datagram(bytes, whole, 8, "s_TICK", tick, size);
    used += add_datagram(bytes + used, first, 20, "s_FLUX_a", tick, 10);
    used += add_datagram(bytes + used, second, 20, NULL, tick, 10);
    return write_seed("tick.datagram", bytes, used);
}

int main(int argc, char **argv) {
    if (argc != 2 || chdir(argv[1]) != 0) {
        return PM_EUSAGE;
    }
    static pm_status (*const make[])(void) = {
        make_dataset,    make_fields,   make_mesh,      make_basis,  make_recording,
        make_checkpoint, make_snapshot, make_messages,  make_heard,  make_replies,
        make_requests,   make_tables,   make_datagrams, make_forgery};
    pm_status status = PM_OK;
    for (size_t i = 0; i < sizeof make / sizeof make[0] && status == PM_OK; ++i) {
        status = make[i]();
    }
    if (status != PM_OK) {
        fprintf(stderr, "make_seeds: %s\n", pm_error());
    }
    return (int)status;
}
