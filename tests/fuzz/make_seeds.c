// make_seeds DIR: writes the binary seeds of the fuzz targets: a small dataset, fields, a basis, a
// checkpoint, messages and datagrams.
#include <stdbool.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "base/rng.h"
#include "bodies/field/field.h"
#include "bodies/modal/basis.h"
#include "lockstep/codec.h"
#include "store/dataset.h"
#include "store/snapshot.h"

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

// For fuzz_message: type and size of arrays, then a flux with one end and one number.
static pm_status make_message(void) {
    double one[6] = {1, 2, 3, 4, 5, 6};
    const portmet_flux_t flux = {.session = 7,
                                 .nend = 1,
                                 .energy_flux = one,
                                 .entropy_flux = one,
                                 .ny = 1,
                                 .y = one,
                                 .e = one,
                                 .eta = one,
                                 .nresponse = 1,
                                 .response = one};
    unsigned char bytes[256] = {0, 1};
    return write_seed("flux.message", bytes,
                      2 + pm_flux_encode(&flux, bytes + 2, sizeof bytes - 2));
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
    static pm_status (*const make[])(void) = {make_dataset,    make_fields,   make_basis,
                                              make_checkpoint, make_snapshot, make_message,
                                              make_datagrams,  make_forgery};
    pm_status status = PM_OK;
    for (size_t i = 0; i < sizeof make / sizeof make[0] && status == PM_OK; ++i) {
        status = make[i]();
    }
    if (status != PM_OK) {
        fprintf(stderr, "make_seeds: %s\n", pm_error());
    }
    return (int)status;
}
