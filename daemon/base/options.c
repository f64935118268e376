// Reads a command line with the table of its options.
#include "base/options.h"

#include <errno.h>
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "base/files.h"

static void print_option(const char *brief, const char *name, const char *value, const char *help) {
    char left[64];
    snprintf(left, sizeof left, "%s%s%s%s%s", brief == NULL ? "    " : brief,
             brief == NULL ? "" : ", ", name, value == NULL ? "" : " ", value == NULL ? "" : value);
    printf("  %-26s %s\n", left, help);
}

// Reads the value of an option with a number.
static pm_status read_number(const pm_option *option, const char *text) {
    char *end;
    errno = 0;
    if (option->positive != NULL) {
        *option->positive = strtod(text, &end);
        end += end != text && strcmp(option->value, "SECONDS") == 0 && *end == 's'; // its unit
        return end != text && *end == 0 && *option->positive > 0 && isfinite(*option->positive)
                   ? PM_OK
                   : pm_fail(PM_EUSAGE, "%s: expected a number > 0, found \"%s\"", option->name,
                             text);
    }
    *option->count = strtoll(text, &end, 10);
    return errno == 0 && end != text && *end == 0 && *option->count >= option->least &&
                   *option->count <= option->most
               ? PM_OK
               : pm_fail(PM_EUSAGE,
                         "%s: expected a whole number from %" PRId64 " to %" PRId64
                         ", found \"%s\"",
                         option->name, option->least, option->most, text);
}

// Stores argument number *i, and the value that follows it if it is an option with a value.
static pm_status take_option(const pm_options *options, int argc, char **argv, int *i) {
    const char *argument = argv[*i], *equals = strchr(argument, '=');
    const size_t length = equals == NULL ? strlen(argument) : (size_t)(equals - argument);
    const char *glued = equals == NULL ? NULL : equals + 1; // a value that "=" joins to the name
    const pm_option *option = NULL;
    for (int k = 0; k < options->count && option == NULL; ++k) {
        const pm_option *o = &options->option[k];
        const bool named = strlen(o->name) == length && strncmp(o->name, argument, length) == 0;
        option = named || (o->brief != NULL && strcmp(o->brief, argument) == 0) ? o : NULL;
    }
    if (option == NULL) {
        return pm_fail(PM_EUSAGE, "%s: unknown option \"%s\"; --help lists the options", argv[0],
                       argument);
    }
    if (option->value == NULL) {
        if (glued != NULL) {
            return pm_fail(PM_EUSAGE, "%s: %s takes no value", argv[0], option->name);
        }
        *option->on = true;
        return PM_OK;
    }
    if (glued == NULL && *i + 1 == argc) {
        return pm_fail(PM_EUSAGE, "%s: %s needs a value (%s)", argv[0], argument, option->value);
    }
    const char *value = glued != NULL ? glued : argv[++*i];
    if (option->text == NULL) {
        return read_number(option, value);
    }
    const bool several = options->several != NULL && strcmp(option->name, options->several) == 0;
    pm_words *words = several ? options->words : NULL;
    for (const struct pm_several *o = options->others; o != NULL && o->name != NULL; ++o) {
        words = strcmp(option->name, o->name) == 0 ? o->words : words;
    }
    if (words == NULL) {
        *option->text = value;
        return PM_OK;
    }
    words->word = words->word != NULL ? words->word : calloc((size_t)argc, sizeof *words->word);
    PM_TRY(pm_allocated(words->word, "%s", argv[0]));
    words->word[words->count++] = value;
    while (glued == NULL && *i + 1 < argc && argv[*i + 1][0] != '-') {
        words->word[words->count++] = argv[++*i];
    }
    *option->text = words->word[0];
    return PM_OK;
}

// Fails with a message about the number of positional arguments. `found` were given; `unexpected`
// is the first one too many, or NULL if too few were given.
static pm_status fail_positional(const pm_options *options, const char *command, int found,
                                 const char *unexpected) {
    char detail[128];
    const char *name = options->positional_name;
    for (int k = found; k > 0 && strchr(name, ' ') != NULL; --k) {
        name = strchr(name, ' ') + 1;
    }
    if (unexpected != NULL) {
        snprintf(detail, sizeof detail, "unexpected \"%.80s\"", unexpected);
    } else {
        snprintf(detail, sizeof detail, "%.*s is missing", (int)strcspn(name, " "), name);
    }
    return pm_fail(PM_EUSAGE, "%s: expected %s, found %d argument%s (%s); usage: %s", command,
                   options->positional_name, found, found == 1 ? "" : "s", detail, options->usage);
}

pm_status pm_options_read(const pm_options *options, int argc, char **argv) {
    for (int i = 1; i < argc; ++i) {
        if (strcmp(argv[i], "--help") != 0 && strcmp(argv[i], "-h") != 0) {
            continue;
        }
        printf("Usage: %s\n\n%s\n\nOptions:\n", options->usage, options->summary);
        for (int k = 0; k < options->count; ++k) {
            const pm_option *o = &options->option[k];
            print_option(o->brief, o->name, o->value, o->help);
        }
        print_option("-h", "--help", NULL, "print this and exit");
        for (const char *line = options->examples; line != NULL; line = strchr(line, '\n')) {
            line += *line == '\n';
            printf("%s  %.*s\n", line == options->examples ? "\nExamples:\n" : "",
                   (int)strcspn(line, "\n"), line);
        }
        printf("\nA value may also follow an equals sign, as in --name=value. Arguments after -- "
               "are not\noptions.\n");
        return PM_HELPED;
    }
    // Keeps as many positional arguments as there is room for, and counts the others.
    int names = 1, found = 0;
    for (const char *at = options->positional_name; *at != '\0'; ++at) {
        names += *at == ' ';
    }
    const int least = options->least > 0 ? options->least : options->least < 0 ? 0 : names;
    const int most = options->most > least ? options->most : least;
    pm_words *words = options->words;
    const char *unexpected = NULL;
    bool only_positional = false;
    for (int i = 1; i < argc; ++i) {
        const char *argument = argv[i];
        if (!only_positional && strcmp(argument, "--") == 0) {
            only_positional = true;
        } else if (!only_positional && argument[0] == '-') {
            PM_TRY(take_option(options, argc, argv, &i));
        } else if (found++ < most) {
            options->positional[found - 1] = argument;
        } else if (unexpected == NULL) {
            unexpected = argument;
        }
    }
    // The last values of `several` may be arguments.
    const int spare = words == NULL ? 0 : words->count - 1;
    const int taken = least - found < spare ? least - found : spare;
    for (int i = 0; i < taken; ++i) {
        options->positional[found++] = words->word[words->count - taken + i];
    }
    if (taken > 0) {
        words->count -= taken;
    }
    if (found < least || found > most) {
        return fail_positional(options, argv[0], found, unexpected);
    }
    for (int i = 0; i < found; ++i) {
        pm_files_note_input(options->positional[i]);
    }
    for (int i = 0; words != NULL && i < words->count; ++i) {
        pm_files_note_input(words->word[i]);
    }
    for (int i = 0; i < options->count; ++i) {
        const pm_option *o = &options->option[i];
        if (o->required && *o->text == NULL) {
            return pm_fail(PM_EUSAGE, "%s: %s %s is missing; usage: %s", argv[0], o->name, o->value,
                           options->usage);
        }
        PM_TRY(o->is_output ? pm_options_output(o->name, *o->text) : PM_OK);
        PM_TRY(o->kind != NULL && *o->text != NULL ? pm_files_check_output(*o->text, o->kind)
                                                   : PM_OK);
    }
    return PM_OK;
}

pm_status pm_options_output(const char *name, const char *path) {
    const char *slash = path == NULL ? NULL : strrchr(path, '/');
    char folder[4096];
    struct stat found;
    if (slash == NULL) {
        return PM_OK;
    }
    snprintf(folder, sizeof folder, "%.*s", slash == path ? 1 : (int)(slash - path), path);
    return stat(folder, &found) == 0 && S_ISDIR(found.st_mode)
               ? PM_OK
               : pm_fail(PM_EFILE, "%s %s: there is no folder %s", name, path, folder);
}

pm_status pm_options_range(const char *text, int count, int *first, int *end) {
    const char *given = text == NULL ? ":" : text;
    char *rest;
    long a = strtol(given, &rest, 10);
    long b = a < count ? a + 1 : a; // "A" alone means one trajectory
    const bool empty = *given == 0 || (rest == given && *rest != ':');
    if (*rest == ':') {
        const char *after = rest + 1;
        b = strtol(after, &rest, 10);
        b = rest == after ? count : b;
    }
    if (empty || *rest != 0 || a < 0 || b > count || a >= b) {
        return pm_fail(PM_EUSAGE, "trajectories \"%s\": expected A:B with 0 <= A < B <= %d", given,
                       count);
    }
    *first = (int)a;
    *end = (int)b;
    return PM_OK;
}

pm_status pm_options_list(const char *text, int count, int *which, int *nwhich) {
    const char *rest = text == NULL ? ":" : text;
    *nwhich = 0;
    while (true) {
        char piece[32];
        const size_t length = strcspn(rest, ",");
        snprintf(piece, sizeof piece, "%.*s", (int)(length < 31 ? length : 31), rest);
        int first = 0, end = 0;
        PM_TRY(pm_options_range(piece, count, &first, &end));
        for (int i = first; i < end; ++i) {
            for (int k = 0; k < *nwhich; ++k) {
                if (which[k] == i) {
                    return pm_fail(PM_EUSAGE, "trajectories \"%s\": %d is named twice", text, i);
                }
            }
            which[(*nwhich)++] = i;
        }
        if (rest[length] == '\0') {
            return PM_OK;
        }
        rest += length + 1;
    }
}

void pm_options_line(int argc, char **argv, char *line, int size) {
    int used = snprintf(line, (size_t)size, "%s", program_invocation_short_name);
    for (int i = 0; i < argc && used < size; ++i) {
        used += snprintf(line + used, (size_t)(size - used), " %s", argv[i]);
    }
}

pm_status pm_options_folder(const char *path) {
    char *part = strdup(path);
    PM_TRY(pm_allocated(part, "%s", path));
    for (char *slash = strchr(part, '/'); slash != NULL; slash = strchr(slash + 1, '/')) {
        *slash = 0;
        mkdir(part, 0777); // a failure shows in the last call
        *slash = '/';
    }
    mkdir(part, 0777);
    free(part);
    return access(path, W_OK | X_OK) == 0
               ? PM_OK
               : pm_fail(PM_EFILE, "%s: cannot make or write this folder", path);
}
