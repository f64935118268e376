// Prints the names of channels and checks their lengths.
#include "transport/channel.h"

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
                       "channel %s: %d characters, at most %d; shorten the names of scene and "
                       "processes",
                       text, length, PM_CHANNEL_SIZE - 1);
    }
    memcpy(channel, text, (size_t)length + 1);
    return PM_OK;
}

pm_status pm_channel_scene(char *channel, const char *scene, const char *word) {
    return print(channel, "%s_%s", scene, word);
}

pm_status pm_channel_process(char *channel, const pm_scene *scene, const char *word,
                             int process_id) {
    return print(channel, "%s_%s_%s", scene->name, word, scene->network.process[process_id].name);
}

pm_status pm_channel_hello(char *channel, const pm_scene *scene, const char *owner) {
    return print(channel, "%s_HELLO%s%s", scene->name, owner[0] != 0 ? "_" : "", owner);
}

pm_status pm_channel_request(char *channel, const pm_scene *scene, const char *owner) {
    return print(channel, "%s_REQUEST_%s", scene->name, owner[0] != 0 ? owner : "TICK");
}
