// The tables that a run prints at its end: mean fluxes, errors against the reference, the residuals
// of energy and entropy, and the speed.
#ifndef PM_APP_REPORT_H
#define PM_APP_REPORT_H

#include "base/record.h"
#include "library/setup.h"
#include "lockstep/pace.h"
#include "scene/recording.h"
#include "sim/ledger.h"

typedef struct pm_report pm_report;

// Makes an empty report; `setup` must outlive it. PM_ENOMEM.
pm_status pm_report_open(pm_report **report, const pm_setup *setup);
void pm_report_close(pm_report *report); // NULL is allowed

// Adds one sample; step 0 comes first.
void pm_report_add(pm_report *report, const pm_sample *sample);

long pm_report_steps(const pm_report *report); // number of steps added, without the initial state

// Puts all numbers that the report needs to continue after a sample into the record.
void pm_report_record(pm_report *report, pm_record *record);

// Prints the tables on standard output. `how` names the transport; `seconds` is the wall time since
// the program's start.
void pm_report_print(const pm_report *report, const pm_ledger *ledger, const char *how,
                     double seconds);

// Prints how the run kept its pace; nothing if the scene has none.
void pm_report_print_pace(const pm_report *report, const pm_pace *pace);

#endif
