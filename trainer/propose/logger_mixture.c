// The text of the energies and of the laws of amounts of substances.
#include "propose/logger_mixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SMALL 0.1
#define NONE 1e-5         // of the largest amount: below it there is hardly any
#define ROOM 293.15       // K
#define ACTIVATION 1000.0 // K
#define CURVES 10.0       // power of the temperature in a rate
#define EQUAL 1e-6        // square of half an affinity over R T, below which a rate is linear in it

// Returns the sum of the mean amounts of a part.
static double mean_amount(const pm_logger_view *v, int part) {
    double amount = 0;
    for (int c = 0; c < v->nvariable; ++c) {
        amount += pm_logger_is(v, c, part, PM_LOGGER_AMOUNT) ? v->column[c].mean : 0;
    }
    return amount;
}

// Writes "(A + B + solvent_part)": the sum of the amounts of a part and of a solvent that does not
// react. With much solvent rates depend on concentrations, and without any on fractions.
static void write_total(pm_logger_writer *w, int part, const char *of, char *text, size_t size) {
    const pm_logger_view *v = w->v;
    size_t n = 0;
    for (int c = 0; c < v->nvariable && n < size; ++c) {
        if (pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            n += (size_t)snprintf(text + n, size - n, "%s%s%.40s", n == 0 ? "(" : " + ", of,
                                  v->column[c].name);
        }
    }
    pm_logger_constant(w, "solvent", v->part[part], mean_amount(v, part), PM_LOGGER_SHARED);
    if (n < size) {
        snprintf(text + n, size - n, " + solvent_%.80s)", v->part[part]);
    }
}

// Writes the size of an amount, which stays positive where there is none yet.
static void write_size(const char *of, const pm_logger_column *n, char *text, size_t size) {
    const double least = NONE * fmax(fabs(n->least), fabs(n->largest));
    snprintf(text, size, "sqrt(%s%.40s^2 + %.4g)", of, n->name, least * least);
}

// Returns the text of the gas constant. If the columns are concentrations, it is learned, because
// the volume is not known.
static const char *gas_constant(pm_logger_writer *w, int part, char *text, size_t size) {
    const pm_unit mol = pm_unit_parse("mol");
    bool amounts = true;
    for (int c = 0; c < w->v->nvariable; ++c) {
        amounts = amounts && (!pm_logger_is(w->v, c, part, PM_LOGGER_AMOUNT) ||
                              pm_unit_equal(&w->v->column[c].dimension, &mol));
    }
    if (amounts) {
        snprintf(text, size, "%.10g", PM_LOGGER_GAS);
    } else {
        pm_logger_constant(w, "mixing", w->v->part[part], PM_LOGGER_GAS, PM_LOGGER_SHARED);
        snprintf(text, size, "mixing_%.80s", w->v->part[part]);
    }
    return text;
}

void pm_logger_write_mixture(pm_logger_writer *w, int part, bool energy) {
    const pm_logger_view *v = w->v;
    const int t = v->thermometer[part];
    const double amount = mean_amount(v, part);
    char total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    if (pm_logger_count(v, part, PM_LOGGER_AMOUNT) == 0 || (t < 0 && !energy)) {
        return;
    }
    write_total(w, part, "", total, sizeof total);
    (void)gas_constant(w, part, gas, sizeof gas);
    const pm_logger_column *T = t < 0 ? NULL : &v->column[t];
    for (int c = 0; c < v->nvariable; ++c) {
        const char *n = v->column[c].name;
        if (!pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            continue;
        }
        if (energy) {
            const double size = PM_LOGGER_GAS * (T == NULL ? v->bath : T->mean);
            fprintf(w->model, "      - \"%s*%s\"\n", pm_logger_number(w, "formation", n, 0, size),
                    n);
            continue;
        }
        fprintf(w->model, "      - \"%s*%s*%s\"\n", T->name,
                pm_logger_number(w, "entropy", n, 0, PM_LOGGER_GAS), n);
        pm_logger_constant(w, "molar", n, SMALL * T->inertia / amount, "");
        fprintf(w->model, "      - \"molar_%s*%s*(%s*ln(%s/%.6g) - %s + %.6g)\"\n", n, n, T->name,
                T->name, T->mean, T->name, T->mean);
    }
    if ((T == NULL) != energy) {
        return;
    }
    // The entropy of mixing, which nobody has to learn.
    if (T != NULL) {
        fprintf(w->model, "      - \"-%s*%s*(", gas, T->name);
    } else {
        fprintf(w->model, "      - \"%s*%.6g*(", gas, v->bath);
    }
    for (int c = 0; c < v->nvariable; ++c) {
        char own[PM_LOGGER_TEXT];
        if (pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            write_size("", &v->column[c], own, sizeof own);
            fprintf(w->model, "%s*ln(%s/%s) + ", v->column[c].name, own, total);
        }
    }
    fprintf(w->model, "solvent_%s*ln(solvent_%s/%s))\"\n", v->part[part], v->part[part], total);
}

void pm_logger_write_reaction(pm_logger_writer *w, int k, const char *of, const char *to) {
    const pm_logger_view *v = w->v;
    const pm_logger_reaction *r = &v->reaction[k];
    const int t = v->thermometer[r->part];
    const double T0 = t < 0 ? v->bath : v->column[t].mean;
    char name[PM_LOGGER_TEXT], T[PM_LOGGER_TEXT], total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    char affinity[PM_LOGGER_LONG_TEXT] = "", product[4 * PM_LOGGER_LONG_TEXT] = "1";
    bool some = false;
    snprintf(name, sizeof name, "%.40s_%d", v->part[r->part], k + 1);
    if (t < 0) {
        snprintf(T, sizeof T, "%sdE.s", to);
    } else {
        snprintf(T, sizeof T, "%s%.60s", to, v->column[t].name);
    }
    write_total(w, r->part, of, total, sizeof total);
    fputs("[{", w->model);
    for (int c = 0; c < v->nvariable; ++c) {
        if (r->number[c] == 0) {
            continue;
        }
        const char *n = v->column[c].name;
        size_t end = strlen(affinity);
        fprintf(w->model, "%s\"%s%s\": %d", pm_logger_separate(&some), of, n, r->number[c]);
        snprintf(affinity + end, sizeof affinity - end, "%s%d*%sdE.%.40s", end > 0 ? " + " : "",
                 r->number[c], of, n);
        end = strlen(product);
        char own[PM_LOGGER_TEXT];
        write_size(of, &v->column[c], own, sizeof own);
        snprintf(product + end, sizeof product - end, "*(%s/%s)^%d", own, total, abs(r->number[c]));
    }
    (void)gas_constant(w, r->part, gas, sizeof gas);
    pm_logger_constant(w, "rate", name, mean_amount(v, r->part) * v->fastest, "");
    if (t < 0) {
        fprintf(w->model, "}, %ss, \"rate_%s", to, name);
    } else {
        fprintf(w->model, "}, %s, \"rate_%s*exp(%s*(1/%.6g - 1/%s)", T, name,
                pm_logger_number(w, "activation", name, 0, ACTIVATION), T0, T);
        fprintf(w->model, " + %s*(ln(%s/%.6g) + %.6g/%s - 1))",
                pm_logger_number(w, "power", name, 0, CURVES), T, T0, T0, T);
    }
    // The forward rate less the backward one is 2 sqrt(product of both) sinh(x/2), where x is the
    // affinity over R T. A pair multiplies its coefficient by the affinity over T, so that the
    // coefficient has sinh(x/2) divided by it.
    char half[2 * PM_LOGGER_LONG_TEXT];
    snprintf(half, sizeof half, "sqrt(((%s)/(2*%s*%s))^2 + %.4g)", affinity, gas, T, EQUAL);
    fprintf(w->model, "*sqrt(%s)*(exp(%s) - exp(-%s))/(2*%s*%s)\"]", product, half, half, half,
            gas);
}

void pm_logger_write_diffusion(pm_logger_writer *w, const pm_logger_column *a,
                               const pm_logger_column *b) {
    char both[PM_LOGGER_TEXT], total[2][PM_LOGGER_LONG_TEXT];
    snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
    write_total(w, a->part, "a.", total[0], sizeof total[0]);
    write_total(w, b->part, "b.", total[1], sizeof total[1]);
    const double start = (a->mean + b->mean) * w->v->fastest / (PM_LOGGER_GAS * ROOM);
    pm_logger_constant(w, "through", both, SMALL * start, "");
    pm_logger_constant(w, "diffusion", both, SMALL * start, "");
    fprintf(w->model, "through_%s + diffusion_%s*(|a.%s|/%s + |b.%s|/%s)", both, both, a->name,
            total[0], b->name, total[1]);
}
