// Decides whether to wait for a message by polling instead of sleeping. A message usually arrives
// before the kernel could put the process to sleep and wake it. For waits expected to be shorter
// than PM_SPIN_LONGEST the process therefore polls, yielding the core between polls. That costs
// nothing while no other process wants the core. If another process wants the core, a yield gives
// it a whole time slice. After such a loss all waits sleep for a while.
#ifndef PM_TRANSPORT_SPIN_H
#define PM_TRANSPORT_SPIN_H

#define PM_SPIN_LONGEST 0.0005 // s, the longest wait for which polling pays
#define PM_SPIN_SLICE 0.001    // s, a yield that takes longer counts as a loss
// After a loss polling pauses, for PM_SPIN_FIRST_PAUSE s at first. If the next loss comes before
// polling has gone on for as long as the pause lasted, the next pause is twice as long, but at most
// PM_SPIN_LONGEST_PAUSE s.
#define PM_SPIN_FIRST_PAUSE 0.1
#define PM_SPIN_LONGEST_PAUSE 10

// The caller owns this storage and initialises it with zeros. Times in s, monotonic.
typedef struct pm_spin {
    double usual;         // a decaying maximum of the last waiting times
    double pause, resume; // length of the last pause, and its end
} pm_spin;

// Returns how long to poll before sleeping, in s; 0: sleep at once. `now` is the present time (s,
// monotonic).
double pm_spin_time(const pm_spin *spin, double now);

// Updates the expected waiting time after a wait for messages that lasted `seconds`, whether the
// process polled or slept.
void pm_spin_note_wait(pm_spin *spin, double seconds);

// Records a yield of the core that lasted `seconds` and ended at `now` (s, monotonic). If it lasted
// longer than PM_SPIN_SLICE, polling pauses.
void pm_spin_note_yield(pm_spin *spin, double seconds, double now);

#endif
