// same_recording A B: compares the series of two recordings, bit by bit, and says where they differ
// first. The files themselves differ, since HDF5 stores the time of writing.
#include <stdio.h>

#include "study/recordings.h"

int main(int argc, char **argv) {
    char difference[512];
    if (argc != 3) {
        fputs("usage: same_recording A B\n", stderr);
        return 2;
    }
    if (pm_recordings_compare(argv[1], argv[2], false, difference, sizeof difference) != PM_OK) {
        fprintf(stderr, "same_recording: %s\n", pm_error());
        return 2;
    }
    if (difference[0] != '\0') {
        fprintf(stderr, "same_recording: %s\n", difference);
    }
    return difference[0] != '\0';
}
