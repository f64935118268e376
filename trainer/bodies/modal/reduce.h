// Fits a basis (basis.h) to the fields of a body, and writes fields as trajectories of its state.
#ifndef PM_BODIES_MODAL_REDUCE_H
#define PM_BODIES_MODAL_REDUCE_H

#include "bodies/field/field.h"
#include "bodies/modal/basis.h"
#include "bodies/solid/symmetry_copies.h"
#include "store/dataset.h"

// Which forces on a body count as its loads: the prescribed ones alone, or the forces of contact
// with other bodies too.
typedef enum pm_load_kind { PM_LOADS_PRESCRIBED, PM_LOADS_OF_ALL } pm_load_kind;

typedef struct pm_reduce_settings {
    int nmode;                         // modes in all, at most PM_BASIS_MAX_MODES
    int nstate;                        // the largest number of modes that carry the energy
    int nlead;                         // the largest number of these that appear in products
    int nturned;                       // modes that are turned until loads move them alone; 0: all
    int nbranch;                       // at most PM_BASIS_MAX_BRANCHES
    double tau[PM_BASIS_MAX_BRANCHES]; // s, relaxation times
    double inertia_time;               // s
    double temperature;                // K
    int displacement_rank, stress_rank;
    int reach;   // sections on either side that the kernel of the local stress spans; 0: no kernel
    bool square; // learn from the eight symmetric copies (symmetry_copies.h)
} pm_reduce_settings;

// Fits a basis to some trajectories of the field; `trajectory` [count] has their numbers. Forces of
// contact count as loads. PM_EDATA, PM_ENUMERIC, PM_ENOMEM. The caller frees the basis.
pm_status pm_reduce_fit(pm_basis **basis, const pm_field *field, int count, const int *trajectory,
                        const pm_reduce_settings *settings);

// Projects the trajectories whose numbers are `trajectory` [count] to the modes, and writes them as
// a dataset with rates. Its columns are a<i>, p<i> and c<k>_<i> of the state, the entropy s, and
// the loads f<i> of the state's modes and h<j> of the other modes. With `square` the eight
// symmetric copies of each trajectory follow one another. PM_EDATA, PM_ENOMEM. The caller frees the
// dataset.
pm_status pm_reduce_project(pm_dataset **dataset, const pm_basis *basis, const pm_field *field,
                            int count, const int *trajectory, bool square, pm_load_kind loads);

// --- regressions ---

// Linear least squares with many dependent variables (`results`) by normal equations, and the best
// solution of low rank (reduced-rank regression: Izenman, J. Multivar. Anal. 5, 1975).

// Sums over the samples of features^T features and features^T results, both weighted.
typedef struct pm_regression {
    int nfeature, nresult;
    double *gram;    // [nfeature][nfeature], upper triangle
    double *cross;   // [nfeature][nresult]
    double *product; // [nfeature][nresult] work space
} pm_regression;

// Allocates the sums and sets them to zero. PM_ENOMEM.
pm_status pm_regression_open(pm_regression *r, int nfeature, int nresult);
void pm_regression_close(pm_regression *r);

// Adds samples that are already multiplied by their weights: features [count][nfeature], results
// [count][nresult].
void pm_regression_add(pm_regression *r, int count, const double *features, const double *results);

// Solves for the coefficients in results = features . coefficients, with a ridge of `ridge` times
// the mean square of each feature. `cross` becomes the coefficients [nfeature][nresult] and `gram`
// its Cholesky factor. PM_ENUMERIC.
pm_status pm_regression_solve(pm_regression *r, double ridge);

// Approximates the solution by coefficient [nfeature][rank] times pattern [rank][nresult], the best
// of this rank over the samples. PM_ENOMEM, PM_ENUMERIC.
pm_status pm_regression_compress(const pm_regression *r, int rank, double *coefficient,
                                 double *pattern);

#endif
