// Which products of columns the changes of a variable need beside the columns themselves: a force
// by a lever that turns, a valve, a capacity that depends on a position, heat of a friction. Terms
// are added to the regression of logger_samples.h on four fifths of the trajectories; they count if
// the changes of the others become less unexplained (sparse identification, Brunton, Proctor, Kutz,
// PNAS 113, 2016, with candidates that have a physical meaning).
#ifndef PM_TRAINER_PROPOSE_LOGGER_TERMS_H
#define PM_TRAINER_PROPOSE_LOGGER_TERMS_H

#include "propose/logger_samples.h"

// Makes columns positions if velocities explain their rates with factors that are functions of
// angles, or of pure numbers such as the components of a direction; and finds velocities that turn
// into each other. The kinds of other positions must be known. Once all `coupled` are, finds which
// lengths store energy together, as those of a body in the plane or in space do, and corrects what
// else changes velocities, beside their springs and beside what turns them. PM_ENOMEM.
pm_status pm_logger_find_guides(pm_logger_samples *w, bool coupled);

// Finds these dependences and writes them to the view, whose columns, actions and couplings must be
// known. PM_ENOMEM.
pm_status pm_logger_find_terms(pm_logger_samples *w);

#endif
