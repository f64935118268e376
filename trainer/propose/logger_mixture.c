// The text of the energies and of the laws of amounts of substances.
#include "propose/logger_mixture.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#define SMALL 0.1
#define ROOM 293.15       // K
#define ACTIVATION 1000.0 // K
#define CURVES 10.0       // power of the temperature in a rate
#define EQUAL 1e-6        // square of half an affinity over R T, below which a rate is linear in it

// Writes "(A + B + C)" of the amounts of a part.
static void write_total(const pm_logger_view *v, int part, const char *of, char *text,
                        size_t size) {
    size_t n = 0;
    for (int c = 0; c < v->nvariable && n < size; ++c) {
        if (pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            n += (size_t)snprintf(text + n, size - n, "%s%s%.40s", n == 0 ? "(" : " + ", of,
                                  v->column[c].name);
        }
    }
    if (n + 1 < size) {
        snprintf(text + n, size - n, ")");
    }
}

// Returns the text of the gas constant, which is learned where concentrations stand for amounts,
// since nobody knows the volume.
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
        pm_logger_constant(w, "mixing", w->v->part[part], PM_LOGGER_GAS);
        snprintf(text, size, "mixing_%.80s", w->v->part[part]);
    }
    return text;
}

void pm_logger_write_mixture(pm_logger_writer *w, int part) {
    const pm_logger_view *v = w->v;
    const int t = v->thermometer[part];
    if (t < 0) {
        return;
    }
    const pm_logger_column *T = &v->column[t];
    char total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    double amount = 0;
    write_total(v, part, "", total, sizeof total);
    for (int c = 0; c < v->nvariable; ++c) {
        amount += pm_logger_is(v, c, part, PM_LOGGER_AMOUNT) ? v->column[c].mean : 0;
    }
    for (int c = 0; c < v->nvariable; ++c) {
        const char *n = v->column[c].name;
        if (!pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            continue;
        }
        (void)gas_constant(w, part, gas, sizeof gas);
        fprintf(w->model, "      - \"%s*(%s*%s - %s*%s*ln(%s/%s))\"\n", T->name,
                pm_logger_number(w, "entropy", n, 0, PM_LOGGER_GAS), n, gas, n, n, total);
        pm_logger_constant(w, "molar", n, SMALL * T->inertia / amount);
        fprintf(w->model, "      - \"molar_%s*%s*(%s*ln(%s/%.6g) - %s + %.6g)\"\n", n, n, T->name,
                T->name, T->mean, T->name, T->mean);
    }
}

void pm_logger_write_formation(pm_logger_writer *w, int part) {
    const pm_logger_view *v = w->v;
    const int t = v->thermometer[part];
    const double T0 = t < 0 ? v->bath : v->column[t].mean;
    char total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    write_total(v, part, "", total, sizeof total);
    for (int c = 0; c < v->nvariable; ++c) {
        const char *n = v->column[c].name;
        if (!pm_logger_is(v, c, part, PM_LOGGER_AMOUNT)) {
            continue;
        }
        fprintf(w->model, "      - \"%s*%s",
                pm_logger_number(w, "formation", n, 0, PM_LOGGER_GAS * T0), n);
        if (t < 0) {
            fprintf(w->model, " + %s*%.6g*%s*ln(%s/%s)", gas_constant(w, part, gas, sizeof gas), T0,
                    n, n, total);
        }
        fputs("\"\n", w->model);
    }
}

void pm_logger_write_reaction(pm_logger_writer *w, int k, const char *of, const char *to) {
    const pm_logger_view *v = w->v;
    const pm_logger_reaction *r = &v->reaction[k];
    const int t = v->thermometer[r->part];
    const double T0 = t < 0 ? v->bath : v->column[t].mean;
    char name[PM_LOGGER_TEXT], T[PM_LOGGER_TEXT], total[PM_LOGGER_LONG_TEXT], gas[PM_LOGGER_TEXT];
    char affinity[PM_LOGGER_LONG_TEXT] = "", product[4 * PM_LOGGER_LONG_TEXT] = "1";
    double amount = 0;
    bool some = false;
    snprintf(name, sizeof name, "%.40s_%d", v->part[r->part], k + 1);
    if (t < 0) {
        snprintf(T, sizeof T, "%sdE.s", to);
    } else {
        snprintf(T, sizeof T, "%s%.60s", to, v->column[t].name);
    }
    write_total(v, r->part, of, total, sizeof total);
    fputs("[{", w->model);
    for (int c = 0; c < v->nvariable; ++c) {
        amount += pm_logger_is(v, c, r->part, PM_LOGGER_AMOUNT) ? v->column[c].mean : 0;
        if (r->number[c] == 0) {
            continue;
        }
        const char *n = v->column[c].name;
        size_t end = strlen(affinity);
        fprintf(w->model, "%s\"%s%s\": %d", pm_logger_separate(&some), of, n, r->number[c]);
        snprintf(affinity + end, sizeof affinity - end, "%s%d*%sdE.%.40s", end > 0 ? " + " : "",
                 r->number[c], of, n);
        end = strlen(product);
        snprintf(product + end, sizeof product - end, "*(%s%.40s/%s)^%d", of, n, total,
                 abs(r->number[c]));
    }
    (void)gas_constant(w, r->part, gas, sizeof gas);
    pm_logger_constant(w, "rate", name, amount * v->fastest);
    if (t < 0) {
        fprintf(w->model, "}, %ss, \"rate_%s", to, name);
    } else {
        fprintf(w->model, "}, %s, \"rate_%s*exp(%s*(1/%.6g - 1/%s)", T, name,
                pm_logger_number(w, "activation", name, 0, ACTIVATION), T0, T);
        fprintf(w->model, " + %s*(ln(%s/%.6g) + %.6g/%s - 1))",
                pm_logger_number(w, "power", name, 0, CURVES), T, T0, T0, T);
    }
    // Forward less backward is the root of both products times twice the hyperbolic sine of half
    // the affinity over R T; a pair multiplies by the affinity over T itself.
    char half[2 * PM_LOGGER_LONG_TEXT];
    snprintf(half, sizeof half, "sqrt(((%s)/(2*%s*%s))^2 + %.4g)", affinity, gas, T, EQUAL);
    fprintf(w->model, "*sqrt(%s)*(exp(%s) - exp(-%s))/(2*%s*%s)\"]", product, half, half, half,
            gas);
}

void pm_logger_write_diffusion(pm_logger_writer *w, const pm_logger_column *a,
                               const pm_logger_column *b) {
    char both[PM_LOGGER_TEXT], total[2][PM_LOGGER_LONG_TEXT];
    snprintf(both, sizeof both, "%.40s_%.40s", a->name, b->name);
    write_total(w->v, a->part, "a.", total[0], sizeof total[0]);
    write_total(w->v, b->part, "b.", total[1], sizeof total[1]);
    const double start = (a->mean + b->mean) * w->v->fastest / (PM_LOGGER_GAS * ROOM);
    pm_logger_constant(w, "through", both, SMALL * start);
    pm_logger_constant(w, "diffusion", both, SMALL * start);
    fprintf(w->model, "through_%s + diffusion_%s*(a.%s/%s + b.%s/%s)", both, both, a->name,
            total[0], b->name, total[1]);
}
