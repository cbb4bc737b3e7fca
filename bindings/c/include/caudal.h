// caudal as a C library. Made by cbindgen from bindings/c/src/lib.rs; do not edit.

#ifndef CAUDAL_H
#define CAUDAL_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

// The status of a call.
typedef enum {
  // Success.
  CAUDAL_OK = 0,
  // The step failed. Everything is as it was before the call.
  CAUDAL_STEP_FAILED = 1,
  // The call is invalid: a null pointer, an unknown name, a wrong length, a value that is not allowed.
  CAUDAL_WRONG_CALL = 2,
  // The scene is invalid, or a file cannot be read.
  CAUDAL_WRONG_SCENE = 3,
  // An internal error of the library. The simulation must be freed.
  CAUDAL_BROKEN = 4,
} caudal_status;

// What determines the value of a variable.
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

// The coordinates of the state with respect to which a step is differentiated.
typedef enum {
  // Positions and velocities. Accelerations follow from them at the beginning of the step.
  CAUDAL_MOTION = 0,
  // All quantities of the motion in a state: also accelerations, and the method's memory of earlier ones.
  CAUDAL_FULL = 1,
} caudal_coordinates;

// A simulation. Only one thread may use it at a time; different simulations are independent.
typedef struct caudal_simulation caudal_simulation;

// A saved state of a simulation.
typedef struct caudal_state caudal_state;

// A variable of a simulation. Its strings live as long as the simulation.
typedef struct {
  // Name, ending in its unit.
  const char *name;
  // SI unit, or "1" if dimensionless.
  const char *unit;
  // Description.
  const char *description;
  // What determines its value.
  caudal_causality causality;
  // Number of values.
  size_t length;
} caudal_variable;

// The derivatives of a step, each in row-major order: a (states x states) and b (states x inputs) of the state at its end, c
// (outputs x states) and d (outputs x inputs) of the outputs there. Null pointers are skipped. Inputs and outputs are counted by
// entry; the entries of an array are consecutive.
typedef struct {
  // Derivatives of the state at the end with respect to the state at the beginning.
  double *a;
  // Derivatives of the state at the end with respect to the inputs.
  double *b;
  // Derivatives of the outputs with respect to the state at the beginning.
  double *c;
  // Derivatives of the outputs with respect to the inputs.
  double *d;
} caudal_derivatives;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// The version of the library.
const char *caudal_version(void);

// The message of the last call in this thread that did not return CAUDAL_OK; valid until the next such call. Empty in a thread
// that is exiting, for example in destructors of its thread-local values.
const char *caudal_message(void);

// Reads the scene in the file `path`, with `count` `overrides` of its keys as "table.key=value", and starts a simulation. Writes
// the simulation to `*simulation`, or null on failure.
caudal_status caudal_load(const char *path,
                          const char *const *overrides,
                          size_t count,
                          caudal_simulation **simulation);

// Frees a simulation. Null is allowed.
void caudal_free(caudal_simulation *simulation);

// Current time, s; NaN for null.
double caudal_time(const caudal_simulation *simulation);

// Advances by `h` (s) to exactly t + h.
caudal_status caudal_do_step(caudal_simulation *simulation, double h);

// Notes on the start and on the steps since the last call of this function, which succeeded nevertheless: that `auto` chose the
// fluid for a rod at rest, because nothing in the scene moves it; that the pose or the velocity of the head given by the host
// jumped. Empty without notes, and for null; valid until the next call of this function for the same simulation.
const char *caudal_note(caudal_simulation *simulation);

// The number of variables, which are indexed from 0; 0 for null.
size_t caudal_variable_count(const caudal_simulation *simulation);

// Writes the index of the variable `name` to `*index`.
caudal_status caudal_find(caudal_simulation *simulation, const char *name, size_t *index);

// Writes the properties of variable `index` to `*variable`. Its strings live as long as the simulation.
caudal_status caudal_describe(caudal_simulation *simulation, size_t index, caudal_variable *variable);

// Reads all `length` values of variable `index`.
caudal_status caudal_get(caudal_simulation *simulation, size_t index, double *out, size_t length);

// Sets all `length` values of the input `index`, which hold until they are set again.
caudal_status caudal_set(caudal_simulation *simulation, size_t index, const double *given, size_t length);

// Sets the time derivative of `order` 1 to 3 of an input. The input is then extrapolated from its value and derivatives, until
// its value is set again. Order 0 is the value.
caudal_status caudal_set_derivative(caudal_simulation *simulation,
                                    size_t index,
                                    size_t order,
                                    const double *given,
                                    size_t length);

// Writes the current first time derivatives of variable `index`: for an input, those of its extrapolation; for a parameter,
// zero.
caudal_status caudal_rate(caudal_simulation *simulation,
                          size_t index,
                          double *out,
                          size_t length);

// The number of coordinates of the state; 0 for null.
size_t caudal_state_count(const caudal_simulation *simulation, caudal_coordinates coordinates);

// Writes positions and velocities, `length` in total, in the order of the coordinates CAUDAL_MOTION: x and y of each node that
// is not held, the angle of a hinge, and the corresponding velocities.
caudal_status caudal_motion(caudal_simulation *simulation,
                            double *out,
                            size_t length);

// Sets positions and velocities, in the order of caudal_motion. Accelerations follow from the equation of motion.
caudal_status caudal_set_motion(caudal_simulation *simulation, const double *given, size_t length);

// Makes a step of `h` (s) as caudal_do_step does, and writes the derivatives of the state and of the outputs with respect to the
// state in these coordinates and to the inputs. Inputs and outputs are given by their indices. If a and c are null, neither is
// computed, which on a fine mesh takes a small fraction of the time and memory. With `jump`, an input acts as if it were set at
// the beginning, where accelerations jump with it; without it, the input had its value before. The matrices of successive steps
// compose with CAUDAL_FULL, and with CAUDAL_MOTION for all methods except generalized-alpha: for an input that is set once and
// then constant, B is A2 B1 + B2, with B1 computed with the jump and B2 without.
caudal_status caudal_linearise(caudal_simulation *simulation,
                               double h,
                               caudal_coordinates coordinates,
                               const size_t *inputs,
                               size_t input_count,
                               const size_t *outputs,
                               size_t output_count,
                               bool jump,
                               const caudal_derivatives *derivatives);

// Saves the state: time, motion, inputs, totals. Replaces `*state`, which is null or a saved state.
caudal_status caudal_save(caudal_simulation *simulation, caudal_state **state);

// Restores a state of the same scene. The run that follows is bit-identical to the run that followed the saved state. A state of
// another scene is rejected.
caudal_status caudal_restore(caudal_simulation *simulation,
                             const caudal_state *state);

// Writes a state as bytes to `bytes`, which has room for `*size`, and their number to `*size`. If `bytes` is null, it writes
// only the number.
caudal_status caudal_serialize(caudal_simulation *simulation,
                               const caudal_state *state,
                               uint8_t *bytes,
                               size_t *size);

// Reads a state from `size` bytes and replaces `*state`, which is null or a saved state. Bytes that are damaged, or come from
// another scene or version, are rejected.
caudal_status caudal_deserialize(caudal_simulation *simulation,
                                 const uint8_t *bytes,
                                 size_t size,
                                 caudal_state **state);

// Frees a state. Null is allowed.
void caudal_free_state(caudal_state *state);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* CAUDAL_H */
