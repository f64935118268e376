// The address and the channels of a scene: mistakes that LCM would refuse are found before a
// process starts.
#include <stdio.h>
#include <string.h>

#include "app/connect.h"
#include "tests/support/unit.h"

static const char text[] = "scene: %s\n"
                           "%s%s%stime: {dt: 1, steps: 1, integrator: euler}\n"
                           "subsystems: {%s: {weights: a.h5, state: {x: {unit: m, size: 3}}}}\n";

// Reads a scene of that name, address (NULL: none) and subsystem, and checks it.
static pm_status check(const char *name, const char *url, const char *subsystem, char *used) {
    char written[1024];
    pm_scene *scene = NULL;
    const bool quoted = url != NULL;
    snprintf(written, sizeof written, text, name, quoted ? "url: '" : "", quoted ? url : "",
             quoted ? "'\n" : "", subsystem);
    assert_int_equal(pm_scene_parse(&scene, written, "t.yaml"), PM_OK);
    const pm_status status = pm_connect_check(scene);
    snprintf(used, 128, "%s", pm_connect_url(scene, NULL));
    pm_scene_free(scene);
    return status;
}

static void an_address_must_name_a_multicast_group_and_a_port(void **state) {
    (void)state;
    static const struct {
        const char *url, *said;
    } bad[] = {
        {"foo://239.255.76.67:7667",
         "url: transport \"foo://239.255.76.67:7667\": expected udpm://ADDRESS:PORT"},
        {"udpm://239.255.76.67", "url: expected udpm://GROUP:PORT"},
        {"mpudpm://239.255.76.67?ttl=1", "found \"mpudpm://239.255.76.67?ttl=1\""},
        {"udpm://239.255.76.67:65536", "url: expected udpm://GROUP:PORT"},
        {"udpm://239.255.76.67:0", "url: expected udpm://GROUP:PORT"},
        {"udpm://239.255.76.67:7667ttl=1", "url: expected udpm://GROUP:PORT"},
        {"udpm://239.255.76.67:+7667", "url: expected udpm://GROUP:PORT"},
        {"udpm://240.0.0.1:7667", "an IPv4 multicast group from 224.0.0.0 to 239.255.255.255"},
        {"udpm://a.name.longer.than.any.address:7667", "found \"udpm://a.name"},
    };
    char used[128];
    for (size_t i = 0; i < sizeof bad / sizeof bad[0]; ++i) {
        assert_int_equal(check("pair", bad[i].url, "left", used), PM_ECONFIG);
        if (strstr(pm_error(), bad[i].said) == NULL ||
            strncmp(pm_error(), "t.yaml:2:6: ", strlen("t.yaml:2:6: ")) != 0) {
            fail_msg("%s: found \"%s\"", bad[i].url, pm_error());
        }
    }
    assert_int_equal(check("pair", "udpm://239.255.76.67:7667?ttl=1", "left", used), PM_OK);
    assert_string_equal(used, "udpm://239.255.76.67:7667?ttl=1");
    assert_int_equal(check("pair", "mpudpm://239.255.76.67:7667", "left", used), PM_OK);
}

static void without_an_address_messages_stay_on_this_host(void **state) {
    (void)state;
    char used[128];
    assert_int_equal(check("pair", NULL, "left", used), PM_OK);
    assert_string_equal(used, "udpm://239.255.76.67:7667?ttl=0");
}

// LCM takes 63 characters, the scene's name included.
static void a_name_that_makes_too_long_a_channel_is_refused(void **state) {
    (void)state;
    static const char name48[] = "abcdefghijklmnopqrstuvwxyzabcdefghijklmnopqrstuv";
    char used[128];
    assert_int_equal(check("scene_7", NULL, name48, used), PM_OK);
    assert_int_equal(check("xscene_7", NULL, name48, used), PM_ECONFIG);
    assert_non_null(strstr(pm_error(), "t.yaml:3:14: "));
    assert_non_null(strstr(pm_error(), "64 characters, at most 63"));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_address_must_name_a_multicast_group_and_a_port),
        cmocka_unit_test(without_an_address_messages_stay_on_this_host),
        cmocka_unit_test(a_name_that_makes_too_long_a_channel_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
