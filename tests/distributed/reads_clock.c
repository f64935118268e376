// A library to be preloaded: the sine follows the clock, as a part would that reads it. Formulas
// with a cosine then have other derivatives in every run.
#include <complex.h>
#include <math.h>
#include <time.h>

double sin(double x) {
    struct timespec now;
    clock_gettime(CLOCK_REALTIME, &now);
    return cimag(cexp(x * I)) * (1 + 1e-9 * (double)(now.tv_nsec % 16));
}
