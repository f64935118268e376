// same_recording A B: compares the datasets of two HDF5 files, bit by bit, and says where and by
// how much they differ. The files themselves differ, since HDF5 stores the time of writing.
#include <hdf5.h>
#include <math.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

typedef struct comparison {
    hid_t other;
    bool names_alone; // whether only datasets count that the other file does not have
    int compared, different;
} comparison;

// The numbers of a dataset, as doubles; NULL if there is no such dataset.
static double *read_numbers(hid_t file, const char *name, hssize_t *count) {
    double *number = NULL;
    const hid_t dataset = H5Dopen(file, name, H5P_DEFAULT);
    if (dataset < 0) {
        return NULL;
    }
    const hid_t space = H5Dget_space(dataset);
    *count = H5Sget_simple_extent_npoints(space);
    number = calloc((size_t)*count + 1, sizeof *number);
    if (number != NULL &&
        H5Dread(dataset, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, number) < 0) {
        free(number);
        number = NULL;
    }
    H5Sclose(space);
    H5Dclose(dataset);
    return number;
}

// Says which numbers of a dataset differ, and by how much.
static void describe(const char *name, const double *a, const double *b, hssize_t count) {
    hssize_t different = 0, first = 0;
    double largest = 0, size = 0;
    for (hssize_t i = 0; i < count; i++) {
        if (memcmp(&a[i], &b[i], sizeof a[i]) != 0) {
            first = different++ == 0 ? i : first;
            largest = fmax(largest, fabs(a[i] - b[i]));
        }
        size = fmax(size, fabs(a[i]));
    }
    fprintf(stderr,
            "same_recording: %s differs: %lld of %lld numbers, the first at %lld, by at most %g "
            "beside %g\n",
            name, (long long)different, (long long)count, (long long)first, largest, size);
}

static herr_t compare(hid_t file, const char *name, const H5L_info_t *info, void *context) {
    (void)info;
    comparison *c = context;
    hssize_t count = 0, other_count = 0;
    double *number = read_numbers(file, name, &count);
    if (number == NULL) {
        return 0; // a group
    }
    double *other = read_numbers(c->other, name, &other_count);
    c->compared += 1;
    if (other == NULL) {
        c->different += 1;
        fprintf(stderr, "same_recording: %s is in one file alone\n", name);
    } else if (!c->names_alone && count != other_count) {
        c->different += 1;
        fprintf(stderr, "same_recording: %s differs: %lld and %lld numbers\n", name,
                (long long)count, (long long)other_count);
    } else if (!c->names_alone && memcmp(number, other, (size_t)count * sizeof *number) != 0) {
        c->different += 1;
        describe(name, number, other, count);
    }
    free(number);
    free(other);
    return 0;
}

int main(int argc, char **argv) {
    if (argc != 3) {
        fputs("usage: same_recording A B\n", stderr);
        return 2;
    }
    H5Eset_auto(H5E_DEFAULT, NULL, NULL);
    const hid_t a = H5Fopen(argv[1], H5F_ACC_RDONLY, H5P_DEFAULT);
    const hid_t b = H5Fopen(argv[2], H5F_ACC_RDONLY, H5P_DEFAULT);
    if (a < 0 || b < 0) {
        fprintf(stderr, "same_recording: cannot open %s\n", a < 0 ? argv[1] : argv[2]);
        return 2;
    }
    comparison forth = {.other = b}, back = {.other = a, .names_alone = true};
    H5Lvisit(a, H5_INDEX_NAME, H5_ITER_INC, compare, &forth);
    H5Lvisit(b, H5_INDEX_NAME, H5_ITER_INC, compare, &back);
    H5Fclose(a);
    H5Fclose(b);
    return forth.compared > 0 && forth.different + back.different == 0 ? 0 : 1;
}
