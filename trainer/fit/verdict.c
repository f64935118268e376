// The verdict on a fit: what was compared, and why it is not good.
#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#include "fit/fit.h"

void pm_verdict_compare(pm_verdict *v, double value, double good, double fair, const char *format,
                        ...) {
    if (isnan(value) || value < good) {
        return;
    }
    const pm_grade grade = value < fair ? PM_GRADE_FAIR : PM_GRADE_POOR;
    v->grade = grade > v->grade ? grade : v->grade;
    if (v->count < PM_VERDICT_MOST) {
        va_list list;
        va_start(list, format);
        vsnprintf(v->reason[v->count++], sizeof *v->reason, format, list);
        va_end(list);
    }
}

void pm_verdict_print(const pm_verdict *v, const char *text) {
    static const char *const name[] = {"good", "fair", "poor"};
    printf("Verdict: %s. %s\n", name[v->grade], text);
    for (int i = 0; i < v->count; ++i) {
        printf("%s%s%s", i == 0 ? "  Not good, since " : "; ", v->reason[i],
               i + 1 == v->count ? ".\n" : "");
    }
    fflush(stdout);
}
