// SPDX-License-Identifier: MIT
// example.c: steps a scene by the shared library and prints an energy and the drift of the total.
//     cc -o example example.c $(pkg-config --cflags --libs libportmet)
//     ./example configs/double_pendulum.yaml
#include <stdio.h>

#include <portmet.h>

int main(int argc, char **argv) {
    portmet_scene *scene;
    if (argc != 2 || portmet_scene_open(&scene, argv[1], NULL) != PORTMET_OK) {
        fprintf(stderr, "%s\n", argc == 2 ? portmet_error() : "expected a scene");
        return 1;
    }
    const double *energy = portmet_scene_array(scene, PORTMET_ENERGY, NULL);
    const double *ledger = portmet_scene_array(scene, PORTMET_LEDGER, NULL);
    while (portmet_scene_steps(scene) < portmet_scene_planned(scene)) {
        if (portmet_scene_step(scene, 1) != PORTMET_OK) {
            fprintf(stderr, "%s\n", portmet_error());
            return 1;
        }
    }
    printf("t = %g s: %s has %.9g J; total %.9g J, drift %.3g J\n", portmet_scene_time(scene),
           portmet_scene_name(scene, PORTMET_SUBSYSTEM, 0), energy[0], ledger[PORTMET_TOTAL_ENERGY],
           ledger[PORTMET_ENERGY_DRIFT]);
    portmet_scene_close(scene);
    return 0;
}
