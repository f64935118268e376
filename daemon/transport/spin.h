// Whether to wait for a message by looking again and again. To be put to sleep and woken costs a
// process more than a message does; one that looks, and yields its core in between, is spared that
// as long as nobody else wants the core. If somebody does, a yield gives away a whole slice of
// time, which one who sleeps would not lose: after such a loss all waits are slept through for a
// while.
#ifndef PM_TRANSPORT_SPIN_H
#define PM_TRANSPORT_SPIN_H

// All in s.
#define PM_SPIN_LONGEST 0.0005  // waits as long as that are not worth it
#define PM_SPIN_SLICE 0.001     // a yield that took longer was such a loss
#define PM_SPIN_FIRST_PAUSE 0.1 // after a loss, doubled by every one that follows as soon
#define PM_SPIN_LONGEST_PAUSE 10

// Storage the caller owns; zero-initialise. Times in s, monotonic.
typedef struct pm_spin {
    double usual;         // how long waits take, the longest of the last few
    double pause, resume; // after the last loss, and when it is over
} pm_spin;

// For how long, from `now` on, to look before sleeping, as the last waits foretell this one; 0: not
// at all.
double pm_spin_time(const pm_spin *spin, double now);

// A wait for messages took `seconds`, slept or not.
void pm_spin_note_wait(pm_spin *spin, double seconds);

// A yield that ended `now` took `seconds`.
void pm_spin_note_yield(pm_spin *spin, double seconds, double now);

#endif
