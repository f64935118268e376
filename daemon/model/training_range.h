// The training range: the region of states on which the weights of a part were trained. For each
// group of variables it is the range of the group's length, or of its value if it has one
// component. A rotated state therefore stays within the range. The length of a vector may leave it
// by a thousandth, since the length of a direction or of a quaternion is constant, but for the
// error of the integrator. The range is kept among the part's constants as "training_range.low" and
// "training_range.high" [1][ngroup], in the units of the groups. Weights without these constants
// have no range, and no state is outside.
#ifndef PM_MODEL_TRAINING_RANGE_H
#define PM_MODEL_TRAINING_RANGE_H

#include "model/part.h"
#include "model/port.h"

// A vector may be longer or shorter than all that training saw by this part of its length.
#define PM_RANGE_SLACK 1e-3

// Declares an empty range for the part. PM_ENOMEM.
pm_status pm_training_range_declare(pm_part *part);
// Empties a declared range again.
void pm_training_range_clear(pm_part *part);
// Widens the range so that it holds the state z [nz].
void pm_training_range_widen(pm_part *part, const double *z);

// The range of a part, looked up once. Borrowed: valid as long as the part.
typedef struct pm_training_range {
    const pm_layout *layout;
    const double *low, *high; // [layout->ngroup]; NULL: the part has no range
} pm_training_range;
pm_training_range pm_training_range_of(const pm_part *part);

// How far a group is outside its range.
typedef struct pm_departure {
    const pm_group *group;   // NULL: no group is outside
    double value, low, high; // of the group, in its unit
    double widths;           // distance to the range, in widths of the range, of which that of a
                             // vector counts as a thousandth of its length at least
} pm_departure;
// Returns how far the group number `g` of the state z [nz] is outside its range.
pm_departure pm_training_range_of_group(pm_training_range range, int g, const double *z);
// Returns the group of the state z [nz] that is furthest outside its range.
pm_departure pm_training_range_departure(pm_training_range range, const double *z);

// The range of what boundary inputs showed to a port in training: of each component of both ends
// the state, its co-energy dE and its dS. It is kept among the port's constants as
// "input_range.low" and "input_range.high" [3][ny_a + ny_b]. What was constant in training, or was
// shown by a subsystem, has no range.

// Declares an empty range for the port. PM_ENOMEM.
pm_status pm_input_range_declare(pm_port_model *port);
// Empties a range; without one it has no effect.
void pm_input_range_clear(pm_port_model *port);
// Widens the range of component c of an end, of its state (which 0), dE (1) or dS (2).
void pm_input_range_widen(pm_port_model *port, pm_end end, int which, int c, double value);
// Gives the range of the same. Returns false if it has none.
bool pm_input_range_of(const pm_port_model *port, pm_end end, int which, int c, double *low,
                       double *high);

#endif
