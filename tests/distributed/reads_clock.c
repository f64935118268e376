// A library to be preloaded: the sine follows the clock, as a part would that reads it. Formulas
// with a cosine then have other derivatives in every run.
#include <complex.h>
#include <math.h>
#include <stdint.h>
#include <time.h>

double sin(double x) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    // A product with 2^32 over the golden ratio scatters clocks that tick in multiples of a power
    // of two, too.
    uint32_t scattered = (uint32_t)now.tv_nsec * UINT32_C(2654435769);
    return cimag(cexp(x * I)) * (1 + 1e-17 * scattered);
}
