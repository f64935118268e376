// The verdict on a fit: what was compared, and why it is not good.
#include <ctype.h>
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

void pm_verdict_print(const pm_verdict *v, const char *text, char record[PM_VERDICT_LENGTH]) {
    static const char *const name[] = PM_VERDICT_WORDS;
    printf("Verdict: %s. %s\n", name[v->grade], text);
    int n = snprintf(record, PM_VERDICT_LENGTH, "%s", name[v->grade]);
    for (int i = 0; i < v->count && n < PM_VERDICT_LENGTH; ++i) {
        n += snprintf(record + n, (size_t)(PM_VERDICT_LENGTH - n), "%s%s", i == 0 ? ": " : "; ",
                      v->reason[i]);
    }
    for (int i = 0; i < v->count; ++i) {
        printf("%s%s%s", i == 0 ? "  Not good, since " : "; ", v->reason[i],
               i + 1 == v->count ? ".\n" : "");
    }
    fflush(stdout);
}

pm_status pm_verdict_unfit(char record[PM_VERDICT_LENGTH], const char *format, ...) {
    char reason[PM_VERDICT_LENGTH];
    va_list list;
    va_start(list, format);
    vsnprintf(reason, sizeof reason, format, list);
    va_end(list);
    snprintf(record, PM_VERDICT_LENGTH, "UNFIT: %.*s", PM_VERDICT_LENGTH - 8, reason);
    printf("Verdict: UNFIT. %c%s.\n", toupper((unsigned char)reason[0]), reason + 1);
    return pm_fail(PM_EUNFIT, "%s", reason);
}
