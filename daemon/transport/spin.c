// Estimates the next waiting time from the last ones, and pauses polling after a loss.
#include "transport/spin.h"

#define DECAY 0.8 // of the maximum, with every shorter wait

double pm_spin_time(const pm_spin *spin, double now) {
    return spin->usual < PM_SPIN_LONGEST && now >= spin->resume ? PM_SPIN_LONGEST : 0;
}

void pm_spin_note_wait(pm_spin *spin, double seconds) {
    spin->usual = seconds > spin->usual ? seconds : DECAY * spin->usual + (1 - DECAY) * seconds;
}

void pm_spin_note_yield(pm_spin *spin, double seconds, double now) {
    if (seconds <= PM_SPIN_SLICE) {
        return;
    }
    const int soon = now - spin->resume < spin->pause;
    spin->pause = soon ? 2 * spin->pause : PM_SPIN_FIRST_PAUSE;
    if (spin->pause > PM_SPIN_LONGEST_PAUSE) {
        spin->pause = PM_SPIN_LONGEST_PAUSE;
    }
    spin->resume = now + spin->pause;
}
