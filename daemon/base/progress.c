// Draws the bar with the remaining time over the bar before.
#include "base/progress.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#define BAR_WIDTH 30
#define REDRAW_INTERVAL 0.1 // s

double pm_clock(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

void pm_progress_init(pm_progress *progress, const char *label, long total) {
    progress->enabled = isatty(STDERR_FILENO) != 0 || getenv("PORTMET_PROGRESS") != NULL;
    progress->started = pm_clock();
    progress->drawn = 0;
    progress->label = label;
    progress->total = total > 0 ? total : 1;
}

void pm_progress_update(pm_progress *progress, long done, const char *detail) {
    const double now = pm_clock();
    if (!progress->enabled || (now - progress->drawn < REDRAW_INTERVAL && done < progress->total)) {
        return;
    }
    progress->drawn = now;
    const double fraction = (double)done / (double)progress->total;
    char bar[BAR_WIDTH + 1];
    memset(bar, ' ', BAR_WIDTH);
    memset(bar, '#', (size_t)(fraction * BAR_WIDTH));
    bar[BAR_WIDTH] = 0;
    const double elapsed = now - progress->started;
    const double left = done > 0 ? elapsed * (1 - fraction) / fraction : 0;
    fprintf(stderr, "\r%s [%s] %ld/%ld  ", progress->label, bar, done, progress->total);
    if (done > 0) {
        fprintf(stderr, "%.0f s left  ", left);
    }
    fprintf(stderr, "%s\033[K", detail == NULL ? "" : detail);
    fflush(stderr);
}

void pm_progress_finish(pm_progress *progress) {
    if (progress->enabled) {
        fputc('\n', stderr);
    }
}

void pm_progress_erase(pm_progress *progress) {
    if (progress->enabled && progress->drawn >= progress->started) {
        fputs("\r\033[K\r", stderr);
        fflush(stderr);
    }
}
