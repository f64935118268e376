// Linear least squares with one result and few terms, by normal equations.
#ifndef PM_TRAINER_PROPOSE_LEAST_SQUARES_H
#define PM_TRAINER_PROPOSE_LEAST_SQUARES_H

#define PM_MAX_TERMS 82

// Sums over the equations x . solution = y. It begins with zeros and the number of terms.
typedef struct pm_least_squares {
    int n; // terms, at most PM_MAX_TERMS
    double matrix[PM_MAX_TERMS * PM_MAX_TERMS], right[PM_MAX_TERMS];
    double square; // of y
} pm_least_squares;

// Adds the equation x [n] . solution = y.
void pm_least_squares_add(pm_least_squares *s, const double *x, double y);
// Writes solution [n] and returns the unexplained fraction of the squares of y, 0 to 1. Returns 1
// and writes zeros if there are no terms, if all y are 0 or if the equations are singular. The sums
// cannot be used afterwards.
double pm_least_squares_solve(pm_least_squares *s, double *solution);

#endif
