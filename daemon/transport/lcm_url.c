// Parses LCM URLs.
#include "transport/lcm_url.h"

#include <arpa/inet.h>
#include <stdlib.h>
#include <string.h>

// Bytes of the kernel's buffer: room for about 9600 small messages; the usual default holds 256.
#define RECEIVE_BUFFER 4000000

// Reads ":PORT", which ends the URL or precedes its options. Returns 0 if the text is something
// else.
static in_port_t read_port(const char *text) {
    if (*text != ':') {
        return 0;
    }
    const size_t count = strspn(text + 1, "0123456789");
    const char end = text[1 + count];
    const long port = strtol(text + 1, NULL, 10);
    const bool good = count > 0 && port >= 1 && port <= 65535 && (end == 0 || end == '?');
    return good ? (in_port_t)port : 0;
}

// Returns the part after "udpm://" or "mpudpm://"; NULL if the URL has another scheme.
static const char *find_address(const char *url) {
    const char *scheme = url + (url[0] == 'm' && url[1] == 'p' ? 2 : 0);
    return strncmp(scheme, "udpm://", 7) == 0 ? scheme + 7 : NULL;
}

static bool read_address(const char *url, struct sockaddr_in *group) {
    const char *address = find_address(url);
    if (address == NULL) {
        return false;
    }
    const size_t host_size = strcspn(address, ":?");
    char host[INET_ADDRSTRLEN] = "";
    if (host_size < sizeof host) {
        memcpy(host, address, host_size);
    }
    *group = (struct sockaddr_in){.sin_family = AF_INET};
    group->sin_port = htons(read_port(address + host_size));
    return inet_pton(AF_INET, host, &group->sin_addr) == 1 &&
           IN_MULTICAST(ntohl(group->sin_addr.s_addr)) && group->sin_port != 0;
}

// Returns the value of an option, and writes its length to `length`; NULL if the URL does not have
// the option.
static const char *find_option(const char *url, const char *name, size_t *length) {
    const char *option = strchr(url, '?');
    while (option != NULL) {
        ++option;
        const size_t size = strlen(name);
        if (strncmp(option, name, size) == 0 && option[size] == '=') {
            *length = strcspn(option + size + 1, "&");
            return option + size + 1;
        }
        option = strchr(option, '&');
    }
    return NULL;
}

static bool is(const char *value, size_t length, const char *word) {
    return value != NULL && length == strlen(word) && strncmp(value, word, length) == 0;
}

// Reads an option whose value is a whole number; `number` keeps its value if the URL does not have
// the option.
static pm_status read_number(const char *url, const char *name, int least, int most, int *number) {
    size_t length = 0;
    const char *value = find_option(url, name, &length);
    if (value == NULL) {
        return PM_OK;
    }
    char *end;
    const long found = strtol(value, &end, 10);
    if (length == 0 || end != value + length || found < least || found > most) {
        return pm_fail(PM_ECONFIG, "expected %d to %d as %s, found \"%.64s\"", least, most, name,
                       url);
    }
    *number = (int)found;
    return PM_OK;
}

static pm_status read_options(const char *url, pm_lcm_url *parsed) {
    parsed->receive_buffer = RECEIVE_BUFFER;
    parsed->ttl = 0;
    PM_TRY(read_number(url, "recv_buf_size", 1, 1 << 30, &parsed->receive_buffer));
    PM_TRY(read_number(url, "ttl", 0, 255, &parsed->ttl));
    size_t length = 0;
    const char *value = find_option(url, "spin", &length);
    const bool no = is(value, length, "no");
    if (value != NULL && !no && !is(value, length, "yes")) {
        return pm_fail(PM_ECONFIG, "expected yes or no as spin, found \"%.64s\"", url);
    }
    parsed->spins = !no;
    value = find_option(url, "receive", &length);
    const bool own = is(value, length, "own"), lcm = is(value, length, "lcm");
    const bool udpm = strncmp(url, "udpm:", 5) == 0;
    if ((value != NULL && !own && !lcm) || (own && !udpm)) {
        return pm_fail(PM_ECONFIG, "expected own (udpm only) or lcm as receive, found \"%.64s\"",
                       url);
    }
    parsed->receives_itself = udpm && !lcm;
    return PM_OK;
}

pm_status pm_lcm_url_parse(const char *url, pm_lcm_url *parsed) {
    if (!read_address(url, &parsed->group)) {
        return pm_fail(PM_ECONFIG,
                       "expected udpm://GROUP:PORT or mpudpm://GROUP:PORT, an IPv4 multicast group "
                       "from 224.0.0.0 to 239.255.255.255 and a port from 1 to 65535, found "
                       "\"%.64s\"",
                       url);
    }
    return read_options(url, parsed);
}
