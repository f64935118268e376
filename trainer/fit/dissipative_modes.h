// The directions of learned irreversible processes (model/dissipation.h).
//
// While all processes of an operator have the same strength, M = G G^T stays the same if the
// columns of G, one for each process, are rotated. The initial weights are chosen in this state
// (model/params.h: late), so that a process which they find may act on two variables that have
// nothing to do with each other, such as a momentum and an internal variable. As soon as strengths
// depend on the state, M can represent two different laws only if the processes are separate. The
// loss hardly depends on the rotation before the strengths differ, nor on the difference of the
// strengths before the processes are separate, so that training cannot find both. Therefore each
// process shall act on as few variables as possible before training moves the strengths.
#ifndef PM_TRAINER_FIT_DISSIPATIVE_MODES_H
#define PM_TRAINER_FIT_DISSIPATIVE_MODES_H

#include "scene/system.h"

// Rotates the columns of the guide [rows][rank] such that rows have large entries in few columns:
// pairwise rotations make the sum of the fourth powers of all entries as large as they can. This is
// the quartimax rotation of factor analysis (Neuhaus, Wrigley, Brit. J. Stat. Psych. 7 (1954) 81).
// The factor [rows][rank] takes part in all rotations.
void pm_dissipative_modes_rotate(int rows, int rank, double *guide, double *factor);

// Separates the processes of every learned irreversible operator of the system that has constant
// entries, `heats`, and processes of equal strength. Rates stay the same. PM_ENOMEM.
pm_status pm_dissipative_modes_separate(pm_system *system);

#endif
