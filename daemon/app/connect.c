// The address, the channels, the key and the transport of a scene.
#include "app/connect.h"

#include <stdio.h>
#include <unistd.h>

#include "transport/channel.h"

// LCM's default group and port, on this host alone.
#define DEFAULT_URL "udpm://239.255.76.67:7667?ttl=0"

pm_status pm_connect_key(const pm_scene *scene, pm_key *key) {
    if (scene->network.key_file == NULL) {
        return PM_OK;
    }
    pm_key read;
    const pm_status status = pm_key_load(&read, scene->network.key_file);
    if (status != PM_OK) {
        return pm_fail(status, "%s: %s", scene->network.key_file_at, pm_error());
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

const char *pm_connect_url(const pm_scene *scene, const char *url) {
    return url != NULL ? url : scene->network.url != NULL ? scene->network.url : DEFAULT_URL;
}

pm_status pm_connect_check(const pm_scene *scene) {
    const pm_status status = pm_transport_check(pm_connect_url(scene, NULL));
    if (status != PM_OK && scene->network.url_at != NULL) {
        return pm_fail(status, "%s: url: %s", scene->network.url_at, pm_error());
    }
    PM_TRY(status);
    for (int i = 0; i < scene->network.nprocess; ++i) {
        // The longest channel of a process is that of its reports.
        char channel[PM_CHANNEL_SIZE];
        const pm_status named = pm_channel_process(channel, scene, "REPORT", i);
        if (named != PM_OK) {
            const pm_scene_process *process = &scene->network.process[i];
            return pm_fail(named, "%s: %s", scene->physics.subsystem[process->subsystem[0]].at,
                           pm_error());
        }
    }
    return PM_OK;
}

// Returns the address at which programs listen to a run of the scene.
static const char *listening_url(const pm_scene *scene) {
    const char *own = pm_connect_url(scene, NULL);
    return pm_transport_has_ranks(own) ? DEFAULT_URL : own;
}

pm_status pm_connect_listener(const pm_scene *scene, const char *url, const char **address) {
    *address = url == NULL ? listening_url(scene) : url;
    return pm_transport_has_ranks(*address)
               ? pm_fail(PM_ECONFIG,
                         "nobody can join the ranks of a run at %s: a scene's `tap` "
                         "repeats chosen messages over LCM",
                         *address)
               : pm_transport_check(*address);
}

pm_status pm_connect_open(pm_transport **transport, const pm_scene *scene, const char *address,
                          const char *name, const pm_journal *log) {
    const pm_tap tap = {listening_url(scene), scene->name, scene->network.ntap, scene->network.tap};
    pm_transport *opened = NULL;
    pm_status status;
    PM_TRY(pm_transport_open(&opened, address));
    if (tap.count > 0 && pm_transport_has_ranks(address)) {
        PM_TRY_DONE(pm_transport_tap(opened, &tap));
    }
    if (scene->network.key_file != NULL) {
        pm_key key;
        char host[64] = "", sender[PM_SEAL_SENDER];
        (void)gethostname(host, sizeof host - 1);
        // A long name must not hide the host's.
        snprintf(sender, sizeof sender, "%.31s@%.31s", name, host);
        PM_TRY_DONE(pm_connect_key(scene, &key));
        status = pm_transport_seal(opened, &key, sender, warn_clock, log);
        pm_key_clear(&key);
        PM_TRY_DONE(status);
    }
    *transport = opened;
    return PM_OK;
done:
    pm_transport_close(opened);
    return status;
}
