// Error codes and the one-line description that travels with them.
//
// A function that can fail for reasons outside the program returns pm_status. The function that
// detects a failure describes it once with pm_fail; callers pass the code up; only main prints the
// description. The comment of a function ends with the codes that it can return, such as
// "PM_EFILE: the file is missing; PM_ENOMEM."
#ifndef PM_BASE_STATUS_H
#define PM_BASE_STATUS_H

// The values are the exit codes of the programs.
typedef enum pm_status {
    PM_HELPED = -1, // the help was printed, and nothing is left to do: programs end with PM_OK
    PM_OK = 0,
    PM_EUSAGE = 2,   // command line
    PM_ECONFIG = 3,  // scene, training or truth file: wrong key, type, name or value
    PM_EFILE = 4,    // a file is missing, unreadable, truncated or of another kind
    PM_EDATA = 5,    // a dataset has missing columns, a wrong shape or values that are not finite
    PM_EWEIGHTS = 6, // weights are missing, damaged or not made for this scene
    PM_ENET = 7,     // transport: no route, no socket, or a peer that was refused
    PM_ETIMEOUT = 8, // a peer was silent for longer than the scene's patience
    PM_ENUMERIC = 9, // a value became non-finite, or a solver failed
    PM_ELAW = 10,    // a law of thermodynamics was violated beyond its tolerance
    PM_ENOMEM = 11,  // out of memory
    PM_EINTERRUPTED = 12, // SIGINT, SIGTERM or SIGHUP
    PM_EUNFIT = 13,       // a trained model is not finite or predicts worse than a constant state
    PM_EBROKEN = 14       // a scene under test or stress has not held
} pm_status;

// Stores the description of a failure for the calling thread and returns `code`. The description is
// one line without a newline: what failed, where, the offending value, and what was expected.
// Control characters become blanks. Modules call it, too (plugin.h).
pm_status pm_fail(pm_status code, const char *format, ...)
    __attribute__((format(printf, 2, 3), visibility("default")));

// Returns PM_OK if `memory` was allocated. If it is NULL, fails with PM_ENOMEM and the description
// "out of memory for <what>", where `what` is a format. Modules call it, too.
pm_status pm_allocated(const void *memory, const char *what, ...)
    __attribute__((format(printf, 2, 3), visibility("default")));

// Returns the calling thread's last description; "" if there is none. The text is valid until the
// next pm_fail or pm_forget_error of this thread.
const char *pm_error(void);
// Forgets the calling thread's last description.
void pm_forget_error(void);

// Returns from the calling function with the value of `expression` unless it is PM_OK.
#define PM_TRY(expression)                       \
    do {                                         \
        pm_status pm_try_status_ = (expression); \
        if (pm_try_status_ != PM_OK) {           \
            return pm_try_status_;               \
        }                                        \
    } while (0)

// Does the same in functions with a clean-up label: sets `status` and jumps to `done`.
#define PM_TRY_DONE(expression) \
    do {                        \
        status = (expression);  \
        if (status != PM_OK) {  \
            goto done;          \
        }                       \
    } while (0)

#endif
