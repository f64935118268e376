// Live inputs: which message holds for a step, and which senders count as alive.
#include "lockstep/live_inputs.h"
#include "portmet_input_t.h"
#include "tests/support/memory_hub.h"
#include "tests/support/unit.h"

static const char text[] = "scene: x\n"
                           "time: {dt: 1, steps: 9, integrator: rk4}\n"
                           "live_inputs:\n"
                           "  FORCE: {values: [f], wait: true, age: 2}\n"
                           "boundary_inputs:\n"
                           "  hand: {q: {unit: m, dE: [f]}}\n"
                           "subsystems:\n"
                           "  a: {weights: a.h5, state: {q: {unit: m, size: 1}}}\n";

static pm_hub *hub;
static pm_transport *own, *sender;
static pm_scene *scene;
static pm_arena arena;
static pm_live_inputs live;
static pm_drops drops;

static int open_inputs(void **state) {
    (void)state;
    drops = (pm_drops){{0}};
    if (pm_hub_open(&hub, NULL) != PM_OK || pm_hub_connect(hub, &own) != PM_OK ||
        pm_hub_connect(hub, &sender) != PM_OK || pm_scene_parse(&scene, text, "t.yaml") != PM_OK ||
        pm_live_inputs_open(&live, scene, &arena, own, NULL, 0, &drops) != PM_OK) {
        fail_msg("%s", pm_error());
    }
    return 0;
}

static int close_inputs(void **state) {
    (void)state;
    pm_transport_close(own);
    pm_transport_close(sender);
    pm_hub_close(hub);
    pm_scene_free(scene);
    pm_arena_free(&arena);
    scene = NULL;
    return 0;
}

static void sends(int64_t step, double value) {
    unsigned char data[64];
    const portmet_input_t message = {.step = step, .n = 1, .value = &value};
    const int size = portmet_input_t_encode(data, 0, sizeof data, &message);
    assert_true(size > 0);
    assert_int_equal(pm_transport_publish(sender, "FORCE", data, (size_t)size), PM_OK);
    assert_int_equal(pm_transport_wait(own, 0, NULL), PM_OK);
}

static void takes(double expected) {
    assert_null(pm_live_inputs_awaited(&live));
    pm_live_inputs_take(&live);
    assert_true(*pm_live_inputs_values(&live, live.next - 1) == expected);
}

// The first of two senders holds. The run tells that the other one sends other values, be it for
// the next step, for a step ahead or for the last one.
static void other_values_for_a_step_are_told(void **state) {
    (void)state;
    sends(0, 1);
    sends(0, 1); // again, since the tick was repeated
    assert_null(live.disputed);
    sends(1, 2);
    sends(1, 7);
    assert_string_equal(live.disputed, "FORCE");
    assert_int_equal(live.disputed_step, 1);
    assert_int_equal(drops.count[PM_DROP_CONFLICT], 1);
    takes(1);
    sends(0, 1);
    assert_int_equal(drops.count[PM_DROP_CONFLICT], 1);
    sends(0, 5);
    assert_int_equal(drops.count[PM_DROP_CONFLICT], 2);
    takes(2);
}

// A sender that repeats an old step is not alive.
static void an_old_step_is_no_sign_of_life(void **state) {
    (void)state;
    sends(0, 1);
    assert_int_equal(pm_live_inputs_check(&live, 10), PM_OK);
    takes(1);
    sends(0, 1);
    assert_int_equal(pm_live_inputs_check(&live, 11.5), PM_OK);
    sends(0, 1);
    assert_int_equal(pm_live_inputs_check(&live, 12.5), PM_ETIMEOUT);
    sends(1, 1); // the step that the run waits for
    assert_int_equal(pm_live_inputs_check(&live, 12.6), PM_OK);
    sends(1, 1);
    assert_int_equal(pm_live_inputs_check(&live, 14.5), PM_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test_setup_teardown(other_values_for_a_step_are_told, open_inputs,
                                        close_inputs),
        cmocka_unit_test_setup_teardown(an_old_step_is_no_sign_of_life, open_inputs, close_inputs),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
