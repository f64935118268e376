// Intervals between requests (exponential back-off), the running median of waiting times, and the
// credit (a token bucket).
#include "lockstep/waiting.h"

// With every wait the median estimate rises or falls by this fraction of itself, independent of the
// length of the wait. A few long waits for lost messages therefore hardly move it.
#define RATE 0.0625

static double clamp(double value, double low, double high) {
    return value < low ? low : value > high ? high : value;
}

void pm_waiting_init(pm_waiting *waiting, int processes, int alike) {
    const double n = processes, longer = PM_WAITING_EACH * n + PM_WAITING_PAIR * n * n;
    const double first = clamp(longer, PM_WAITING_FIRST, PM_WAITING_MOST);
    *waiting = (pm_waiting){.first = first,
                            .last = clamp(2 * first, PM_WAITING_LAST, 2 * PM_WAITING_MOST),
                            .refill = PM_WAITING_REFILL * alike,
                            .credit = 1};
}

// Returns the median estimate after a wait of `taken` s; it is at most `first`.
static double follow(double usual, double taken, double first) {
    if (usual == 0) {
        return first / PM_WAITING_FACTOR;
    }
    const double moved = usual * (taken > usual ? 1 + RATE : 1 - RATE);
    return clamp(moved, PM_WAITING_SOONEST / PM_WAITING_FACTOR, first / PM_WAITING_FACTOR);
}

void pm_waiting_start(pm_waiting *waiting, double now) {
    waiting->usual = follow(waiting->usual, now - waiting->since, waiting->first);
    waiting->since = now;
    waiting->interval =
        waiting->cautious_waits > 0 ? PM_WAITING_FACTOR * waiting->usual : waiting->first;
    waiting->cautious_waits -= waiting->cautious_waits > 0;
    waiting->next = now + waiting->interval;
}

void pm_waiting_note_used(pm_waiting *waiting) {
    waiting->credit = clamp(waiting->credit + PM_WAITING_SHARE, waiting->credit, PM_WAITING_CREDIT);
}

// Lets the credit grow with time. Returns true if it allows a request.
static bool can_pay(pm_waiting *waiting, double now) {
    const double more = waiting->credited > 0 ? (now - waiting->credited) / waiting->refill : 0;
    waiting->credit = clamp(waiting->credit + more, waiting->credit, PM_WAITING_CREDIT);
    waiting->credited = now;
    return waiting->credit >= 1;
}

bool pm_waiting_request_due(pm_waiting *waiting, double now) {
    if (now < waiting->next) {
        return false;
    }
    if (!can_pay(waiting, now)) {
        waiting->next = now + (1 - waiting->credit) * waiting->refill + PM_WAITING_SOONEST;
        return false;
    }
    waiting->interval *= 2;
    if (waiting->interval > waiting->last) {
        waiting->interval = waiting->last;
    }
    waiting->next = now + waiting->interval;
    waiting->cautious_waits = PM_WAITING_LATELY;
    return true;
}

void pm_waiting_note_requests(pm_waiting *waiting, int count) {
    waiting->credit -= count;
}

bool pm_waiting_is_long(const pm_waiting *waiting) {
    // Among many processes a request to all costs much, and steps take longer anyway.
    return waiting->interval >= waiting->last &&
           waiting->next - waiting->since >= PM_WAITING_LONG * waiting->first;
}

bool pm_waiting_is_over(const pm_waiting *waiting, double heard, double patience, double now) {
    return now - waiting->since > patience && now - heard > patience;
}
