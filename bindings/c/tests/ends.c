/* What a host asks at the edges: rates of inputs, a step too short to move, a head that jumps,
 * a scene that nothing moves, and calls from a thread that ends. */
#include "caudal.h"
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <string.h>

static pthread_key_t key;
static int answered = 0;

static void at_end(void *unused) {
    (void)unused;
    answered = caudal_do_step(NULL, 1.0) == CAUDAL_WRONG_CALL && caudal_message() != NULL;
}

static void *run(void *unused) {
    pthread_setspecific(key, &key);
    caudal_do_step(NULL, 1.0);
    return unused;
}

static int is(const char *what, double found, double wanted) {
    if (found != wanted)
        printf("%s: %.17g, not %.17g\n", what, found, wanted);
    return found == wanted;
}

enum { NODES = 33, STATES = 4 * (NODES - 1) };

/* The matrices of a step, against the difference of two that begin a little apart. */
static int step_is_linearised(const char *scene) {
    static double motion[STATES], a[STATES * STATES], b[STATES * NODES], c[STATES], d[NODES], ends[2][STATES], tips[2];
    const caudal_derivatives all = {a, b, c, d};
    const double h = 4e-3, size = 1e-5;
    caudal_simulation *tail = NULL;
    caudal_state *start = NULL;
    size_t force, tip;
    int fine = caudal_load(scene, NULL, 0, &tail) == CAUDAL_OK && caudal_do_step(tail, 0.1) == CAUDAL_OK;
    fine &= caudal_find(tail, "force_y_n", &force) == CAUDAL_OK && caudal_find(tail, "tip_y_m", &tip) == CAUDAL_OK;
    fine &= is("number of states", (double)caudal_state_count(tail, CAUDAL_MOTION), STATES);
    fine &= caudal_motion(tail, motion, STATES) == CAUDAL_OK && caudal_set_motion(tail, motion, STATES) == CAUDAL_OK;
    fine &= caudal_motion(tail, motion, 1) == CAUDAL_WRONG_CALL && caudal_set_motion(tail, motion, 1) == CAUDAL_WRONG_CALL;
    fine &= caudal_save(tail, &start) == CAUDAL_OK;
    fine &= caudal_linearise(tail, h, CAUDAL_MOTION, &force, 1, &tip, 1, true, &all) == CAUDAL_OK;
    fine &= caudal_linearise(tail, h, CAUDAL_MOTION, &tip, 1, &tip, 1, true, &all) == CAUDAL_WRONG_CALL;
    fine &= caudal_linearise(tail, h, CAUDAL_MOTION, NULL, 0, NULL, 0, true, NULL) == CAUDAL_WRONG_CALL;
    for (int end = 0; end < 2; end++) {
        fine &= caudal_restore(tail, start) == CAUDAL_OK;
        motion[STATES - 1] += end == 0 ? size : -2 * size; /* the speed of the tip, y */
        fine &= caudal_set_motion(tail, motion, STATES) == CAUDAL_OK && caudal_do_step(tail, h) == CAUDAL_OK;
        fine &= caudal_motion(tail, ends[end], STATES) == CAUDAL_OK && caudal_get(tail, tip, &tips[end], 1) == CAUDAL_OK;
    }
    for (int i = 0; i < STATES; i++)
        fine &= fabs(a[(i + 1) * STATES - 1] - (ends[0][i] - ends[1][i]) / (2 * size)) < 1e-5;
    fine &= fabs(c[STATES - 1] - (tips[0] - tips[1]) / (2 * size)) < 1e-7;
    fine &= d[NODES - 1] > 0 && b[STATES * NODES - 1] > 0;
    fine &= is("derivatives of a step", fine, 1);
    caudal_free_state(start);
    caudal_free(tail);
    return fine;
}

enum { FULL_MOST = 8 * NODES };

/* By an input that is set once and kept, the matrix of two steps is that of the first, which jumps, carried on, and that of the second. */
static int steps_compose(const char *scene) {
    static double a[FULL_MOST * FULL_MOST], b[3][FULL_MOST * NODES];
    const double h = 4e-3;
    caudal_simulation *tail = NULL;
    caudal_state *start = NULL;
    size_t force;
    int fine = caudal_load(scene, NULL, 0, &tail) == CAUDAL_OK && caudal_do_step(tail, 0.1) == CAUDAL_OK;
    const size_t states = caudal_state_count(tail, CAUDAL_FULL);
    fine &= states <= FULL_MOST && caudal_find(tail, "force_y_n", &force) == CAUDAL_OK;
    fine &= caudal_save(tail, &start) == CAUDAL_OK;
    for (int jump = 0; fine && jump < 2; jump++) {
        const caudal_derivatives both = {a, b[0], NULL, NULL}, first = {a, b[1], NULL, NULL}, second = {a, b[2], NULL, NULL};
        fine &= caudal_linearise(tail, 2 * h, CAUDAL_FULL, &force, 1, NULL, 0, true, &both) == CAUDAL_OK;
        fine &= caudal_restore(tail, start) == CAUDAL_OK;
        fine &= caudal_linearise(tail, h, CAUDAL_FULL, &force, 1, NULL, 0, true, &first) == CAUDAL_OK;
        fine &= caudal_linearise(tail, h, CAUDAL_FULL, &force, 1, NULL, 0, jump, &second) == CAUDAL_OK;
        fine &= caudal_restore(tail, start) == CAUDAL_OK;
        double most = 0.0, off = 0.0;
        for (size_t i = 0; i < states; i++) {
            double sum = b[2][i * NODES + NODES - 1];
            for (size_t k = 0; k < states; k++)
                sum += a[i * states + k] * b[1][k * NODES + NODES - 1];
            const double whole = b[0][i * NODES + NODES - 1];
            most = fabs(whole) > most ? fabs(whole) : most;
            off = fabs(sum - whole) > off ? fabs(sum - whole) : off;
        }
        printf("two steps, the second with jump = %d: off by %.1e of the largest\n", jump, off / most);
        fine &= (off / most < 1e-12) == !jump; /* 1.3e-14 without the jump, 1.1 with it */
    }
    fine &= is("steps that compose", fine, 1);
    caudal_free_state(start);
    caudal_free(tail);
    return fine;
}

int main(int count, char **arguments) {
    caudal_simulation *tail = NULL;
    size_t head, viscosity, time, mass;
    double rate = NAN, zero = 0.0, one = 1.0;
    if (count < 2 || caudal_load(arguments[1], NULL, 0, &tail) != CAUDAL_OK)
        return 1;
    caudal_find(tail, "head_x_m", &head);
    caudal_find(tail, "viscosity_pa_s", &viscosity);
    caudal_find(tail, "time_s", &time);
    caudal_find(tail, "mass_kg", &mass);
    caudal_set(tail, head, &zero, 1);
    caudal_set_derivative(tail, head, 1, &one, 1);
    caudal_set_derivative(tail, viscosity, 1, &one, 1);
    int fine = 1;
    fine &= caudal_rate(tail, head, &rate, 1) == CAUDAL_OK && is("rate of an input of the head", rate, 1.0);
    fine &= caudal_rate(tail, viscosity, &rate, 1) == CAUDAL_OK && is("rate of an input", rate, 1.0);
    fine &= caudal_rate(tail, time, &rate, 1) == CAUDAL_OK && is("rate of the time", rate, 1.0);
    fine &= caudal_rate(tail, mass, &rate, 1) == CAUDAL_OK && is("rate of a parameter", rate, 0.0);
    fine &= caudal_do_step(tail, 1e-10) == CAUDAL_OK;
    fine &= caudal_get(tail, time, &rate, 1) == CAUDAL_OK && is("time", rate, caudal_time(tail));
    double far = 1.0;
    fine &= caudal_do_step(tail, 1e-2) == CAUDAL_OK && is("note of a smooth motion", caudal_note(tail)[0], '\0');
    fine &= caudal_set(tail, head, &far, 1) == CAUDAL_OK && caudal_do_step(tail, 1e-2) == CAUDAL_OK;
    fine &= is("note of a jump", strstr(caudal_note(tail), "position x given for the head") != NULL, 1);
    fine &= is("note that was read", caudal_note(tail)[0], '\0') && is("note of nothing", caudal_note(NULL)[0], '\0');
    caudal_free(tail);
    const char *still[] = {"drag.law=auto", "head.kind=clamped"};
    fine &= caudal_load(arguments[1], still, 2, &tail) == CAUDAL_OK;
    fine &= is("note of a rod at rest", strstr(caudal_note(tail), "nothing in the scene moves this rod") != NULL, 1);
    fine &= is("that note again", caudal_note(tail)[0], '\0');
    caudal_free(tail);
    fine &= step_is_linearised(arguments[1]);
    fine &= steps_compose(arguments[1]);
    pthread_t thread;
    pthread_key_create(&key, at_end);
    pthread_create(&thread, NULL, run, NULL);
    pthread_join(thread, NULL);
    fine &= is("answered", answered, 1);
    return !fine;
}
