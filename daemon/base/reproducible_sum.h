// A sum of numbers whose bits depend neither on their order nor on how they are divided into
// partial sums. Every number is split at fixed powers of two, and the pieces of equal weight are
// added up without rounding. What is smaller than three pieces hold is rounded off: the error for
// each number is at most 2^-52 of the largest one. The method is that of J. Demmel and H. D.
// Nguyen, "Parallel reproducible summation", IEEE Trans. Comput. 64, 2015.
#ifndef PM_BASE_REPRODUCIBLE_SUM_H
#define PM_BASE_REPRODUCIBLE_SUM_H

#include <stdbool.h>
#include <stdint.h>

// A struct of zeros is the empty sum. All members are numbers that a message can carry.
typedef struct pm_reproducible_sum {
    double top;     // which piece the first part adds up, counted from the smallest one; 0: none
    double part[3]; // sums of the pieces `top`, `top` - 1 and `top` - 2
} pm_reproducible_sum;

// Adds x [count], or the magnitudes of these numbers, to the sum. At most 2^26 numbers may be added
// in all. A number that is not finite makes the value not finite.
void pm_reproducible_sum_add(pm_reproducible_sum *sum, int64_t count, const double *x,
                             bool magnitudes);
// Adds another sum to the sum.
void pm_reproducible_sum_merge(pm_reproducible_sum *sum, const pm_reproducible_sum *other);
// Returns the value of the sum.
double pm_reproducible_sum_value(const pm_reproducible_sum *sum);

#endif
