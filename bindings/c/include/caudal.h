// caudal as a C library. Made by cbindgen from bindings/c/src/lib.rs; do not edit.

#ifndef CAUDAL_H
#define CAUDAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// How a call ended.
typedef enum {
  // All well.
  CAUDAL_OK = 0,
  // The step could not be made; everything is as it was before the call.
  CAUDAL_STEP_FAILED = 1,
  // The call is wrong: a null pointer, an unknown name, a wrong length, a value that is not allowed.
  CAUDAL_WRONG_CALL = 2,
  // The scene is wrong, or a file cannot be read.
  CAUDAL_WRONG_SCENE = 3,
  // An error inside the library; the simulation must be freed.
  CAUDAL_BROKEN = 4,
} caudal_status;

// Who decides the value of a variable.
typedef enum {
  // Fixed by the scene.
  CAUDAL_PARAMETER = 0,
  // Set by the host.
  CAUDAL_INPUT = 1,
  // Computed.
  CAUDAL_OUTPUT = 2,
  // Time.
  CAUDAL_INDEPENDENT = 3,
} caudal_causality;

// The coordinates of the state that the derivatives of a step are taken by.
typedef enum {
  // Positions and velocities; accelerations follow from them at the beginning of the step.
  CAUDAL_MOTION = 0,
  // All that a state has of the motion: accelerations too, and what a method remembers of earlier ones.
  CAUDAL_FULL = 1,
} caudal_coordinates;

// A simulation. It is used by one thread at a time; different ones are independent.
typedef struct caudal_simulation caudal_simulation;

// A state of a simulation, to go back to.
typedef struct caudal_state caudal_state;

// A variable of a simulation. Its texts live as long as the simulation.
typedef struct {
  // Name, ending in its unit.
  const char *name;
  // SI unit; "1" where there is none.
  const char *unit;
  // What it is.
  const char *description;
  // Who decides it.
  caudal_causality causality;
  // Number of values.
  size_t length;
} caudal_variable;

// The derivatives of a step, each row by row: a (states x states) and b (states x inputs) of the state at its end, c (outputs x states) and
// d (outputs x inputs) of the outputs there. Null pointers are left out. Inputs and outputs count by entry, an array's all in a row.
typedef struct {
  // By the state at the beginning, of the state at the end.
  double *a;
  // By the inputs, of the state.
  double *b;
  // By the state, of the outputs.
  double *c;
  // By the inputs, of the outputs.
  double *d;
} caudal_derivatives;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The version of the library.
const char *caudal_version(void);

// Why the last call of this thread that did not end in CAUDAL_OK did not; valid until the next such call. Empty in a thread that
// ends, as in the destructors of its own values.
const char *caudal_message(void);

// Reads the scene in the file `path`, with `count` `overrides` of its keys as "table.key=value", and starts it. Writes the
// simulation to `*simulation`, or null where that fails.
caudal_status caudal_load(const char *path,
                          const char *const *overrides,
                          size_t count,
                          caudal_simulation **simulation);

// Frees a simulation; null is fine.
void caudal_free(caudal_simulation *simulation);

// Time now, s; NaN for null.
double caudal_time(const caudal_simulation *simulation);

// Moves on by `h` (s) to exactly t + h.
caudal_status caudal_do_step(caudal_simulation *simulation, double h);

// What the start and the steps since the last call of this have to say, although they were made: that `auto` chose the fluid for a rod at
// rest, because nothing of the scene moves it; that the pose or the velocity of the head which the host gave jumped. Empty where there is
// nothing to say, and for null; valid until the next call of this with the same simulation.
const char *caudal_note(caudal_simulation *simulation);

// The number of variables; 0 for null. They are counted from 0.
size_t caudal_variable_count(const caudal_simulation *simulation);

// Writes the index of the variable called `name` to `*index`.
caudal_status caudal_find(caudal_simulation *simulation, const char *name, size_t *index);

// Writes what there is to know of variable `index` to `*variable`; its texts live as long as the simulation.
caudal_status caudal_describe(caudal_simulation *simulation, size_t index, caudal_variable *variable);

// Reads all `length` values of variable `index`.
caudal_status caudal_get(caudal_simulation *simulation, size_t index, double *out, size_t length);

// Sets all `length` values of the input `index`; they hold until they are set again.
caudal_status caudal_set(caudal_simulation *simulation, size_t index, const double *given, size_t length);

// Sets the time derivative of an input, of `order` 1 to 3: from now on the input goes on as its value and derivatives say,
// until its value is set again. Order 0 is the value.
caudal_status caudal_set_derivative(caudal_simulation *simulation,
                                    size_t index,
                                    size_t order,
                                    const double *given,
                                    size_t length);

// Writes the first derivatives by time of variable `index` now: of an input as it goes on, of a parameter zero.
caudal_status caudal_rate(caudal_simulation *simulation, size_t index, double *out, size_t length);

// The number of coordinates of the state, 0 without a simulation.
size_t caudal_state_count(const caudal_simulation *simulation, caudal_coordinates coordinates);

// Writes positions and velocities, `length` in all, in the order of the coordinates CAUDAL_MOTION: x and y of each node that nothing
// holds, the angle of a hinge, and the same of their velocities.
caudal_status caudal_motion(caudal_simulation *simulation,
                            double *out,
                            size_t length);

// Sets positions and velocities, in the order of caudal_motion; accelerations follow from the equation of motion.
caudal_status caudal_set_motion(caudal_simulation *simulation, const double *given, size_t length);

// Makes a step of `h` (s) as caudal_do_step does, and writes its derivatives by the state in these coordinates and by the inputs, of the
// state and of the outputs, which are given by their indices. Without room for a and c (null) neither is found, which on a fine mesh
// takes a small part of the time and memory. With `jump` an input acts as if it were set at the beginning, where accelerations jump with it;
// without it the input had its value before. The matrices of successive steps compose with CAUDAL_FULL, and with CAUDAL_MOTION by all methods
// but generalized-alpha: of an input that is set once and kept, B is A2 B1 + B2, B1 with the jump and B2 without.
caudal_status caudal_linearise(caudal_simulation *simulation,
                               double h,
                               caudal_coordinates coordinates,
                               const size_t *inputs,
                               size_t input_count,
                               const size_t *outputs,
                               size_t output_count,
                               bool jump,
                               const caudal_derivatives *derivatives);

// Saves the state: time, motion, inputs, totals. Over `*state`, which is null or a state from here.
caudal_status caudal_save(caudal_simulation *simulation, caudal_state **state);

// Goes back to a state of the same scene; what follows is equal to the bit to what followed then. A state of another scene is
// refused.
caudal_status caudal_restore(caudal_simulation *simulation,
                             const caudal_state *state);

// Writes a state as bytes to `bytes`, which has room for `*size`, and their number to `*size`. Without room (`bytes` null)
// it writes the number only.
caudal_status caudal_serialize(caudal_simulation *simulation,
                               const caudal_state *state,
                               uint8_t *bytes,
                               size_t *size);

// Reads a state from `size` bytes, over `*state`, which is null or a state from here. Bytes of another scene, of another
// version or damaged ones are refused.
caudal_status caudal_deserialize(caudal_simulation *simulation,
                                 const uint8_t *bytes,
                                 size_t size,
                                 caudal_state **state);

// Frees a state; null is fine.
void caudal_free_state(caudal_state *state);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* CAUDAL_H */
