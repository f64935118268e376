// One line for the run and one for each process.
#include "app/health_table.h"

#define MEBIBYTE 1048576.0

static void print_run(FILE *file, const pm_scene *scene, const portmet_health_t *h) {
    fprintf(file, "%s: step %lld of %lld, %.3g steps/s", scene->name,
            (long long)(h->step < 0 ? 0 : h->step), (long long)h->steps, h->rate);
    for (int i = 0; i < h->nprocess; ++i) {
        if (h->silent[i] < 0 && h->step < 0) {
            fprintf(file, "; %s is missing", pm_health_name(scene, i));
        } else if (h->silent[i] > pm_health_silence(h->nprocess)) {
            fprintf(file, "; %s is silent", pm_health_name(scene, i));
        }
    }
    if (h->blocker != PM_HEALTH_NOBODY) {
        fprintf(file, "; all others wait for %s", pm_health_name(scene, h->blocker));
    }
    for (int i = 0; i < h->nprocess; ++i) {
        if (h->loss[i] > PM_HEALTH_LOSS) {
            fprintf(file, "; %.0f %% lost from %s to %s", 100 * h->loss[i],
                    pm_health_name(scene, h->loses_from[i]), pm_health_name(scene, i));
        }
    }
    fprintf(file, "\n");
}

static void print_part(FILE *file, const pm_scene *scene, int64_t peer, double part) {
    char text[64] = "-";
    if (peer != PM_HEALTH_NOBODY) {
        snprintf(text, sizeof text, "%.16s %.0f %%", pm_health_name(scene, peer), 100 * part);
    }
    fprintf(file, " %-20s", text);
}

static void print_process(FILE *file, const pm_scene *scene, const portmet_health_t *h, int i) {
    fprintf(file, "%-16.16s", scene->process[i].name);
    if (h->silent[i] < 0) {
        fprintf(file, " has not told yet how it is doing\n");
        return;
    }
    fprintf(file, " %9lld %9.4g %6.0f %8.0f", (long long)h->process_step[i], h->process_rate[i],
            100 * h->cpu[i], 100 * h->computing[i]);
    print_part(file, scene, h->waits_for[i], h->waits_part[i]);
    print_part(file, scene, h->loses_from[i], h->loss[i]);
    fprintf(file, " %7.3g %7.3g %8lld %8lld", h->asks[i], h->answers[i], (long long)h->drops[i],
            (long long)h->strange[i]);
    if (h->checkpoint_age[i] < 0) {
        fprintf(file, " %10s", "none");
    } else {
        fprintf(file, " %8.0f s", h->checkpoint_age[i]);
    }
    fprintf(file, " %6.1f %8.0f\n", (double)h->rss[i] / MEBIBYTE, h->silent[i]);
}

void pm_health_table_print(FILE *file, const pm_scene *scene, const portmet_health_t *health) {
    print_run(file, scene, health);
    fprintf(file, "%-16s %9s %9s %6s %8s %-20s %-20s %7s %7s %8s %8s %10s %6s %8s\n", "process",
            "step", "steps/s", "CPU, %", "busy, %", "waits for", "loses from", "asks/s", "sends/s",
            "dropped", "strange", "checkpoint", "MiB", "silent s");
    for (int i = 0; i < health->nprocess; ++i) {
        print_process(file, scene, health, i);
    }
    fflush(file);
}

void pm_health_table_log(const pm_journal *log, const pm_scene *scene,
                         const portmet_health_t *health) {
    const portmet_health_t *h = health;
    const pm_journal_field run[] = {{.name = "step", .number = (double)h->step},
                                    {.name = "steps", .number = (double)h->steps},
                                    {.name = "rate", .number = h->rate},
                                    {.name = "blocker", .text = pm_health_name(scene, h->blocker)}};
    pm_journal_write(log, PM_JOURNAL_NOTICE, 4, run, "status of the run");
    for (int i = 0; i < h->nprocess; ++i) {
        const pm_journal own = {log->json, log->program, scene->process[i].name};
        const pm_journal_field field[] = {
            {.name = "step", .number = (double)h->process_step[i]},
            {.name = "rate", .number = h->process_rate[i]},
            {.name = "cpu", .number = h->cpu[i]},
            {.name = "computing", .number = h->computing[i]},
            {.name = "waits_for", .text = pm_health_name(scene, h->waits_for[i])},
            {.name = "waits_part", .number = h->waits_part[i]},
            {.name = "loses_from", .text = pm_health_name(scene, h->loses_from[i])},
            {.name = "loss", .number = h->loss[i]},
            {.name = "rss", .number = (double)h->rss[i]},
            {.name = "silent", .number = h->silent[i]},
        };
        pm_journal_write(&own, PM_JOURNAL_NOTICE, (int)(sizeof field / sizeof field[0]), field,
                         "status of %s", scene->process[i].name);
    }
}
