// Batches in which samples with large residuals are more likely. A few rare states often dominate a
// loss. A batch that was drawn uniformly misses most of them, and its step does not lower the loss
// of all samples. Samples are therefore chosen with unequal probabilities and weighted by their
// inverse, so that the expected gradient stays that of all samples (Horvitz, Thompson, J. Am. Stat.
// Assoc. 47 (1952) 663).
#ifndef PM_TRAINER_OPTIMISE_IMPORTANCE_H
#define PM_TRAINER_OPTIMISE_IMPORTANCE_H

// Replaces share [count], the shares of samples in the loss (>= 0), by the probabilities with which
// a batch contains them. One half of the probability is equal for all samples, the other half is
// proportional to the share. No probability exceeds 1, and their sum is `wanted`, which is at most
// `count`.
void pm_importance_chances(int count, double *share, int wanted);

// Chooses samples by systematic sampling: writes the numbers (0 to count - 1) of the chosen samples
// to `chosen`, which has room for `wanted` + 1 of them, and returns how many these are: `wanted`,
// or one more or less by rounding. `chance` [count] has the sum `wanted`; `uniform` is a random
// number in [0, 1). Samples next to each other should be in random order.
int pm_importance_choose(int count, const double *chance, int wanted, double uniform, int *chosen);

#endif
