// The address, the channels, the key and the transport of a scene.
#include "app/connect.h"

#include <stdio.h>
#include <unistd.h>

#include "app/notify.h"
#include "transport/channel.h"

// LCM's default group and port, on this host alone.
#define DEFAULT_URL "udpm://239.255.76.67:7667?ttl=0"

pm_status pm_connect_key(const pm_scene *scene, pm_key *key) {
    if (scene->key_file == NULL) {
        return PM_OK;
    }
    pm_key read;
    const pm_status status = pm_key_load(&read, scene->key_file);
    if (status != PM_OK) {
        return pm_fail(status, "%s: %s", scene->key_file_at, pm_error());
    }
    if (key != NULL) {
        *key = read;
    }
    pm_key_clear(&read);
    return PM_OK;
}

static void warn_clock(const void *context, const char *sender, double seconds) {
    const pm_journal *log = context;
    const pm_journal_field field[] = {{.name = "sender", .text = sender},
                                      {.name = "seconds", .number = seconds}};
    pm_journal_write(log, PM_JOURNAL_WARNING, 2, field, "clock of %s differs by %.0f s", sender,
                     seconds);
}

static pm_status seal(pm_transport *transport, const pm_scene *scene, const char *name,
                      const pm_journal *log) {
    pm_key key;
    char host[64] = "", sender[PM_SEAL_SENDER];
    (void)gethostname(host, sizeof host - 1);
    // A long name must not hide the host's.
    snprintf(sender, sizeof sender, "%.31s@%.31s", name, host);
    PM_TRY(pm_connect_key(scene, &key));
    const pm_status status = pm_transport_seal(transport, &key, sender, warn_clock, log);
    pm_key_clear(&key);
    return status;
}

// The longest channel of a process is that of its reports.
static pm_status check_channels(const pm_scene *scene) {
    for (int i = 0; i < scene->nprocess; ++i) {
        char channel[PM_CHANNEL_SIZE];
        const pm_status status = pm_channel_process(channel, scene, "REPORT", i);
        if (status != PM_OK) {
            const pm_scene_process *process = &scene->process[i];
            return pm_fail(status, "%s: %s", scene->subsystem[process->subsystem[0]].at,
                           pm_error());
        }
    }
    return PM_OK;
}

pm_status pm_connect_check(pm_scene *scene) {
    if (scene->url == NULL) {
        scene->url = DEFAULT_URL;
    }
    scene->tap_url = pm_transport_has_ranks(scene->url) ? DEFAULT_URL : scene->url;
    const pm_status status = pm_transport_check(scene->url);
    if (status != PM_OK && scene->url_at != NULL) {
        return pm_fail(status, "%s: url: %s", scene->url_at, pm_error());
    }
    PM_TRY(status);
    return check_channels(scene);
}

pm_status pm_connect_listener(pm_scene *scene, const char *url) {
    scene->url = url == NULL ? scene->tap_url : url;
    return pm_transport_has_ranks(scene->url)
               ? pm_fail(PM_ECONFIG,
                         "nobody can join the ranks of a run at %s: a scene's `tap` "
                         "repeats chosen messages over LCM",
                         scene->url)
               : pm_transport_check(scene->url);
}

pm_status pm_connect_refuse_ranks(const pm_scene *scene, const char *command) {
    return pm_transport_has_ranks(scene->url)
               ? pm_fail(PM_EUSAGE,
                         "%s does not work at %s: mpirun starts all processes, by "
                         "\"mpirun -n %d portmetd run %s --url %s\"",
                         command, scene->url, scene->nprocess + 1, scene->path, scene->url)
               : PM_OK;
}

// Repeats the channels of the scene's tap over LCM, where the transport is another one.
static pm_status tap(pm_transport *transport, const pm_scene *scene) {
    const pm_tap tap = {scene->tap_url, scene->name, scene->ntap, scene->tap};
    return scene->ntap > 0 && pm_transport_has_ranks(scene->url) ? pm_transport_tap(transport, &tap)
                                                                 : PM_OK;
}

pm_status pm_connect_open(pm_transport **transport, const pm_scene *scene, const char *name,
                          const pm_journal *log) {
    pm_transport *opened = NULL;
    PM_TRY(pm_transport_open(&opened, scene->url, NULL));
    pm_status status = tap(opened, scene);
    if (status == PM_OK && scene->key_file != NULL) {
        status = seal(opened, scene, name, log);
    }
    if (status != PM_OK) {
        pm_transport_close(opened);
        return status;
    }
    *transport = opened;
    pm_notify("READY=1");
    return PM_OK;
}

void pm_connect_warn(const pm_transport *transport, const pm_drops *drops, const pm_journal *log) {
    // A best-effort network, or another run of the same scene, causes other drops; they do not
    // count.
    const pm_drops *below = pm_transport_drops(transport);
    char list[256];
    size_t used = 0;
    long total = 0;
    for (int i = 0; i < PM_NDROP; ++i) {
        const pm_drop drop = (pm_drop)i;
        const long count = pm_drop_is_strange(drop) ? drops->count[i] + below->count[i] : 0;
        if (count > 0 && used < sizeof list) {
            const int length = snprintf(list + used, sizeof list - used, "%s%ld %s",
                                        total > 0 ? ", " : "", count, pm_drop_name(drop));
            used += length < 0 ? 0 : (size_t)length;
        }
        total += count;
    }
    if (total > 0) {
        const pm_journal_field count = {.name = "dropped", .number = (double)total};
        pm_journal_write(log, PM_JOURNAL_WARNING, 1, &count, "messages dropped: %s", list);
    }
}
