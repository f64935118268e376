// A library to be preloaded: powers follow the clock, as a part would that reads it. A scene with a
// tolerance then chooses other steps in every run.
#include <math.h>
#include <stdint.h>
#include <time.h>

double pow(double x, double y) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    // A product with 2^32 over the golden ratio scatters clocks that tick in multiples of a power
    // of two, too.
    uint32_t scattered = (uint32_t)now.tv_nsec * UINT32_C(2654435769);
    return exp(y * log(x)) * (0.5 + 0x1p-32 * scattered);
}
