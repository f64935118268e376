// Names of channels.
#include "net/channel.h"

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

__attribute__((format(printf, 2, 3))) static pm_status print(char *channel, const char *format,
                                                             ...) {
    char text[4 * PM_CHANNEL_SIZE];
    va_list arguments;
    va_start(arguments, format);
    const int length = vsnprintf(text, sizeof text, format, arguments);
    va_end(arguments);
    if (length < 0 || length >= PM_CHANNEL_SIZE) {
        return pm_fail(PM_ECONFIG,
                       "channel %s: %d characters, at most %d; shorten the names of scene, "
                       "subsystems or ports",
                       text, length, PM_CHANNEL_SIZE - 1);
    }
    memcpy(channel, text, (size_t)length + 1);
    return PM_OK;
}

pm_status pm_channel_scene(char *channel, const pm_scene *scene, const char *word) {
    return print(channel, "%s_%s", scene->name, word);
}

pm_status pm_channel_subsystem(char *channel, const pm_scene *scene, const char *word,
                               int subsystem_id) {
    return print(channel, "%s_%s_%s", scene->name, word, scene->subsystem[subsystem_id].name);
}

static pm_status print_flux(char *channel, const pm_scene *scene, int port_id, pm_end from) {
    const pm_scene_port *port = &scene->port[port_id];
    const int own = (int)from;
    return print(channel, "%s_FLUX_%s_%s_%s", scene->name, pm_scene_end_name(scene, port, own),
                 pm_scene_end_name(scene, port, 1 - own), port->name);
}

pm_status pm_channel_flux(char *channel, const pm_scene *scene, int port_id, pm_end from) {
    char other[PM_CHANNEL_SIZE];
    PM_TRY(print_flux(channel, scene, port_id, from));
    for (int i = 0; i < scene->nport; ++i) {
        for (int end = 0; end < 2; ++end) {
            if (i == port_id && end == (int)from) {
                continue;
            }
            PM_TRY(print_flux(other, scene, i, (pm_end)end));
            if (strcmp(channel, other) == 0) {
                return pm_fail(PM_ECONFIG,
                               "ports \"%s\" and \"%s\" would share the channel %s; rename one",
                               scene->port[port_id].name, scene->port[i].name, channel);
            }
        }
    }
    return PM_OK;
}
