/* A proportional controller steers a swimming tail: it bends the whole tail against the drift of its centre of mass.
 *
 *   steer SCENE [gain [table.key=value]...]
 *
 * prints time, x, y and the bend (1/m) every 0.1 s, and at the end shows that going back to a saved state repeats the run. */

#include <caudal.h>
#include <stdio.h>
#include <stdlib.h>

/* Ends the program where a call was not answered well. */
static void must(caudal_status status, const char *what)
{
    if (status != CAUDAL_OK) {
        fprintf(stderr, "%s: %s\n", what, caudal_message());
        exit(1);
    }
}

static double scalar(caudal_simulation *tail, size_t variable)
{
    double value = 0.0;
    must(caudal_get(tail, variable, &value, 1), "get");
    return value;
}

/* Steers until the time `end`, and returns y of the centre of mass. */
static double steer(caudal_simulation *tail, double gain, double end, int print)
{
    const double h = 0.01;
    size_t x, y, natural;
    must(caudal_find(tail, "x_com_m", &x), "x_com_m");
    must(caudal_find(tail, "y_com_m", &y), "y_com_m");
    must(caudal_find(tail, "natural_curvature_1_m", &natural), "natural_curvature_1_m");
    caudal_variable joints;
    must(caudal_describe(tail, natural, &joints), "describe");
    double *bend = malloc(joints.length * sizeof *bend);
    if (bend == NULL)
        exit(1);
    for (int step = 0; caudal_time(tail) < end - 0.5 * h; step++) {
        const double wanted = -gain * scalar(tail, y);
        for (size_t k = 0; k < joints.length; k++)
            bend[k] = wanted;
        must(caudal_set(tail, natural, bend, joints.length), "set");
        must(caudal_do_step(tail, h), "step");
        if (print && step % 10 == 9)
            printf("%.17g %.17g %.17g %.17g\n", caudal_time(tail), scalar(tail, x), scalar(tail, y), wanted);
    }
    free(bend);
    return scalar(tail, y);
}

int main(int argc, char **argv)
{
    if (argc < 2) {
        fprintf(stderr, "usage: %s SCENE [gain [table.key=value]...]\n", argv[0]);
        return 2;
    }
    const double gain = argc > 2 ? atof(argv[2]) : 5.0;
    const char *const *overrides = argc > 3 ? (const char *const *)argv + 3 : NULL;
    caudal_simulation *tail = NULL;
    must(caudal_load(argv[1], overrides, argc > 3 ? (size_t)argc - 3 : 0, &tail), "load");
    steer(tail, gain, 0.5, 1);

    /* What was saved, written as bytes and read again goes on as before. */
    caudal_state *state = NULL, *copy = NULL;
    must(caudal_save(tail, &state), "save");
    size_t size = 0;
    must(caudal_serialize(tail, state, NULL, &size), "size");
    unsigned char *bytes = malloc(size);
    if (bytes == NULL)
        return 1;
    must(caudal_serialize(tail, state, bytes, &size), "serialize");
    must(caudal_deserialize(tail, bytes, size, &copy), "deserialize");
    const double once = steer(tail, gain, 1.0, 1);
    must(caudal_restore(tail, copy), "restore");
    const double again = steer(tail, gain, 1.0, 0);
    free(bytes);
    caudal_free_state(state);
    caudal_free_state(copy);

    /* Mistakes are answered, they do not end the program. */
    size_t none;
    caudal_simulation *other;
    if (caudal_find(tail, "x_com", &none) != CAUDAL_WRONG_CALL || caudal_do_step(tail, -1.0) != CAUDAL_WRONG_CALL ||
        caudal_do_step(NULL, 0.1) != CAUDAL_WRONG_CALL || caudal_get(tail, 0, NULL, 1) != CAUDAL_WRONG_CALL ||
        caudal_load("nowhere.toml", NULL, 0, &other) != CAUDAL_WRONG_SCENE) {
        fprintf(stderr, "a mistake was not answered\n");
        return 1;
    }
    caudal_free(tail);
    return once == again ? 0 : 1;
}
