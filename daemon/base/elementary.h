// Elementary functions in plain C99: the same bits on every processor that follows IEEE 754, alone
// or in a vectorised loop, since they have no table, no branch and no fused multiply-add. portmetd
// uses them, and the C source that it exports begins with a copy of this file. Results are exact to
// two units in the last place.
#ifndef PM_BASE_ELEMENTARY_H
#define PM_BASE_ELEMENTARY_H

#include <stdint.h>
#include <string.h>

// 2^n for a whole number n, -1022 <= n <= 1023.
static inline double pm_power_of_two(double n) {
    // Adding 1.5 * 2^52 leaves the exponent n + 1023 in the lowest bits of the sum.
    const double shifted = n + (6755399441055744.0 + 1023.0);
    uint64_t bits;
    double result;
    memcpy(&bits, &shifted, sizeof bits);
    bits <<= 52;
    memcpy(&result, &bits, sizeof result);
    return result;
}

// Splits x = n ln 2 + r with a whole n and |r| <= ln 2 / 2 (Cody and Waite 1980). Returns n.
static inline double pm_reduce(double x, double *r) {
    const double shift = 6755399441055744.0; // 1.5 * 2^52: adding it rounds a number to a whole one
    const double n = (x * 1.44269504088896338700e+00 + shift) - shift;
    *r = (x - n * 6.93147180369123816490e-01) - n * 1.90821492927058770002e-10;
    return n;
}

// exp(r) - 1 for |r| <= ln 2 / 2, by its Taylor polynomial of degree 13. The groups of four terms
// (Estrin's scheme) are independent of each other, so that the processor can evaluate them at the
// same time.
static inline double pm_short_expm1(double r) {
    const double r2 = r * r, r4 = r2 * r2;
    const double low = (0.5 + r * (1.0 / 6.0)) + (1.0 / 24.0 + r * (1.0 / 120.0)) * r2;
    const double middle =
        (1.0 / 720.0 + r * (1.0 / 5040.0)) + (1.0 / 40320.0 + r * (1.0 / 362880.0)) * r2;
    const double high = (1.0 / 3628800.0 + r * (1.0 / 39916800.0)) +
                        (1.0 / 479001600.0 + r * (1.0 / 6227020800.0)) * r2;
    return r + r2 * (low + (middle + high * r4) * r4);
}

// exp(x). The result is exp(-708) for all x below -708, and infinite from x = 709.4 on.
static inline double pm_exp_of(double x) {
    double r;
    x = x < -708.0 ? -708.0 : x;
    x = x > 710.0 ? 710.0 : x;
    const double n = pm_reduce(x, &r);
    const double power = pm_power_of_two(n);
    return power + power * pm_short_expm1(r);
}

// tanh(x) = sign(x) e / (e + 2) with e = exp(2 |x|) - 1.
static inline double pm_tanh_of(double x) {
    double twice = 2.0 * (x < 0 ? -x : x), r;
    twice = twice > 40.0 ? 40.0 : twice; // from |x| = 20 on the result is 1
    const double n = pm_reduce(twice, &r);
    const double power = pm_power_of_two(n);
    const double e = power * pm_short_expm1(r) + (power - 1.0);
    const double y = e / (e + 2.0);
    return x < 0 ? -y : y;
}

// 1 / (1 + exp(-x)).
static inline double pm_sigmoid_of(double x) {
    return 1.0 / (1.0 + pm_exp_of(-x));
}

// R(f) of log(1 + f) = f - f^2/2 + s (f^2/2 + R) for sqrt(1/2) - 1 <= f <= sqrt(2) - 1: with
// s = f/(2 + f) it is the series of log((1 + s)/(1 - s)) from s^2 on, with the coefficients of
// FDLIBM, e_log.c and s_log1p.c. z is s^2.
static inline double pm_log_series(double z) {
    double p = 1.479819860511658591e-01;
    p = p * z + 1.531383769920937332e-01;
    p = p * z + 1.818357216161805012e-01;
    p = p * z + 2.222219843214978396e-01;
    p = p * z + 2.857142874366239149e-01;
    p = p * z + 3.999999999940941908e-01;
    p = p * z + 6.666666666666735130e-01;
    return p * z;
}

// log(1 + u) for 0 <= u <= 1. The function writes 1 + u as 1 + f with f = u or, if u exceeds
// sqrt(2) - 1, as 2 (1 + f) with f = (u - 1)/2.
static inline double pm_log1p_of(double u) {
    const double fold = u > 0.41421356237309503 ? 1.0 : 0.0;
    const double f = fold * (0.5 * (u - 1.0)) + (1.0 - fold) * u;
    const double s = f / (2.0 + f), half = 0.5 * f * f;
    const double series = f - (half - s * (half + pm_log_series(s * s)));
    return fold * 6.93147180369123816490e-01 + (series + fold * 1.90821492927058770002e-10);
}

// log(x), with x = 2^n (1 + f) and sqrt(1/2) <= 1 + f <= sqrt(2). The result is not a number for x
// below 0, and -infinity for 0.
static inline double pm_log_of(double x) {
    const double tiny = x < 2.2250738585072014e-308 ? 1.0 : 0.0;  // has no exponent of its own
    const double normal = x * (1.0 + tiny * 18014398509481983.0); // times 2^54
    uint64_t bits, exponent, mantissa;
    double shifted, m;
    memcpy(&bits, &normal, sizeof bits);
    // The exponent becomes the lowest bits of a number from 2^52 on.
    exponent = (bits >> 52) | 0x4330000000000000u;
    mantissa = (bits & 0x000fffffffffffffu) | 0x3ff0000000000000u;
    memcpy(&shifted, &exponent, sizeof shifted);
    memcpy(&m, &mantissa, sizeof m);
    const double fold = m > 1.4142135623730951 ? 1.0 : 0.0;
    const double n = (shifted - (4503599627370496.0 + 1023.0)) + (fold - 54.0 * tiny);
    const double f = (m - 0.5 * fold * m) - 1.0;
    const double s = f / (2.0 + f), half = 0.5 * f * f;
    const double series = s * (half + pm_log_series(s * s)) + n * 1.90821492927058770002e-10;
    const double y = n * 6.93147180369123816490e-01 - ((half - series) - f);
    const double limit = x == 0 ? -1.0 / 0.0 : 0.0 / 0.0;
    return x > 0 ? (x < 1.0 / 0.0 ? y : x) : limit;
}

// sin(x + quarter pi/2) for a whole `quarter`. It splits x = n pi/2 + r with |r| <= pi/4, where
// pi/2 is the sum of three numbers (Cody and Waite 1980; the first two have 33 bits, so that their
// products with n are exact), and takes the series of sin(r) or of cos(r) with the coefficients of
// FDLIBM, k_sin and k_cos. From |x| = 1.6e6 on the products are rounded: the error is then as
// large as that of an x which is rounded to the last place.
static inline double pm_sine_of(double x, double quarter) {
    const double shift = 6755399441055744.0; // as in pm_reduce
    const double n = (x * 6.36619772367581382433e-01 + shift) - shift;
    const double first = x - n * 1.57079632673412561417e+00;
    const double second = n * 6.07710050630396597660e-11, whole = first - second;
    const double lost = (first - whole) - second; // what rounding took
    double r = whole - (n * 2.02226624871116645580e-21 - lost);
    r = r > 1.0 ? 1.0 : r; // where x has no digits behind the point
    r = r < -1.0 ? -1.0 : r;
    const double z = r * r, z2 = z * z, half = 0.5 * z, rest = 1.0 - half;
    const double odd = (-1.66666666666666324348e-01 + 8.33333333332248946124e-03 * z) +
                       ((-1.98412698298579493134e-04 + 2.75573137070700676789e-06 * z) +
                        (-2.50507602534068634195e-08 + 1.58969099521155010221e-10 * z) * z2) *
                           z2;
    const double even = (4.16666666666666019037e-02 + -1.38888888888741095749e-03 * z) +
                        ((2.48015872894767294178e-05 + -2.75573143513906633035e-07 * z) +
                         (2.08757232129817482790e-09 + -1.13596475577881948265e-11 * z) * z2) *
                            z2;
    const double sine = r + r * z * odd, cosine = rest + (((1.0 - rest) - half) + z2 * even);
    const double shifted = (n + quarter) + shift;
    uint64_t turns, s, c;
    double y;
    memcpy(&turns, &shifted, sizeof turns);
    memcpy(&s, &sine, sizeof s);
    memcpy(&c, &cosine, sizeof c);
    // The lowest bit of n + quarter says which of both it is, the next one its sign.
    const uint64_t swap = 0 - (turns & 1);
    s = ((s & ~swap) | (c & swap)) ^ ((turns & 2) << 62);
    memcpy(&y, &s, sizeof y);
    return y;
}

static inline double pm_sin_of(double x) {
    return pm_sine_of(x, 0.0);
}

static inline double pm_cos_of(double x) {
    return pm_sine_of(x, 1.0);
}

// log(1 + exp(x)) = max(x, 0) + log(1 + exp(-|x|)), which does not overflow.
static inline double pm_softplus_of(double x) {
    return (x > 0 ? x : 0.0) + pm_log1p_of(pm_exp_of(x < 0 ? x : -x));
}

#endif
