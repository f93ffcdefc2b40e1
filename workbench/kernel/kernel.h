/* kernel.h: what the shared library exports.
 *
 * Python fills the structures of the other headers (workbench/kernel/structs.py), keeps all that they point to
 * alive, and makes one call for many steps. The kernel has no global state and keeps no pointer after `close`.
 */
#ifndef WORKBENCH_KERNEL_H
#define WORKBENCH_KERNEL_H

#include "algebraic.h"
#include "arithmetic.h"
#include "blocks.h"
#include "control.h"
#include "cs.h"
#include "intermediate.h"
#include "lti.h"
#include "master.h"
#include "me.h"
#include "parent.h"
#include "predictor.h"
#include "timing.h"

/* To be raised with every change of a structure or of the meaning of a call. */
enum { KERNEL_VERSION = 22 };

KERNEL_EXPORT int32_t kernel_version(void);
/* Size of a structure by its name, 0 if there is none: the caller compares it with its own. */
KERNEL_EXPORT size_t kernel_sizeof(const char *structure);
/* Names of the FMI functions in the order of FunctionIndex; NULL behind the last. */
KERNEL_EXPORT const char *kernel_function_name(size_t index);

/* Check and complete what the caller filled in; 0: an FMI version is unknown. */
KERNEL_EXPORT int32_t kernel_system_open(System *system);

/* These return 1, or 0 after noting the reason in system->failure; PAUSED: call go_on. */
KERNEL_EXPORT int32_t kernel_me_open(Me *me);
KERNEL_EXPORT int32_t kernel_me_restart(Me *me);
KERNEL_EXPORT int32_t kernel_me_run(Me *me, double until, const double *targets, size_t n_targets, Record *record,
                                    int32_t fresh);
KERNEL_EXPORT int32_t kernel_me_go_on(Me *me);
KERNEL_EXPORT void kernel_me_close(Me *me);
KERNEL_EXPORT int32_t kernel_cs_run(Cs *cs, double until, const double *targets, size_t n_targets, Record *record,
                                    int32_t fresh);
KERNEL_EXPORT int32_t kernel_cs_go_on(Cs *cs);
/* See `time_steps`. */
KERNEL_EXPORT size_t kernel_time_steps(System *system, double time, double step, size_t n, double patience,
                                       double *seconds);
/* How many doubles `saved` of the control of `cs` needs. */
KERNEL_EXPORT size_t kernel_control_doubles(const Cs *cs);

/* Copy the rows to `columns` [width][rows]. */
KERNEL_EXPORT void kernel_record_columns(const Record *record, double *columns);
KERNEL_EXPORT void kernel_record_free(Record *record);

KERNEL_EXPORT double kernel_signal_value(const Signal *signal, double t);
KERNEL_EXPORT double kernel_signal_next_break(const Signal *signal, double t);

/* Fourier coefficients of rows [n][width]; `fourier` names columns and memory. */
KERNEL_EXPORT void kernel_fourier(Fourier *fourier, const double *rows, size_t n, size_t width, double *coefficients);
KERNEL_EXPORT void kernel_fourier_result(const Fourier *fourier, double *coefficients);
KERNEL_EXPORT void kernel_fourier_rough(const Fourier *fourier, double *errors);

/* States and errors of the one-step prediction of `samples` rows of u and y; `state` is that of the first sample,
 * and afterwards that of the sample behind the last. */
KERNEL_EXPORT void kernel_predict(const Predictor *model, size_t samples, const double *u, const double *y,
                                  double *state, double *states, double *errors);
/* R(k) of R(k+1) = R(k) f + signals(k) ⊗ c, f [n][n], c [p][n]: out [samples][p][count][n]; `rows` is R(0), and
 * afterwards that of the sample behind the last. */
KERNEL_EXPORT void kernel_sensitivities(const double *f, const double *c, size_t n, size_t p, size_t count,
                                        size_t samples, const double *signals, double *rows, double *out);

/* Blocks, with the signatures of FMI 2.0. */
KERNEL_EXPORT int lti_set_time(Lti *lti, double time);
KERNEL_EXPORT int lti_set_states(Lti *lti, const double *x, size_t n);
KERNEL_EXPORT int lti_get_states(Lti *lti, double *x, size_t n);
KERNEL_EXPORT int lti_get_derivatives(Lti *lti, double *dx, size_t n);
KERNEL_EXPORT int lti_enter_event_mode(Lti *lti);
KERNEL_EXPORT int lti_enter_continuous_mode(Lti *lti);
KERNEL_EXPORT int lti_update(Lti *lti, LtiEventInfo *info);
KERNEL_EXPORT int lti_get_directional(Lti *lti, const uint32_t *unknowns, size_t n_unknowns, const uint32_t *knowns,
                                      size_t n_knowns, const double *seed, double *sensitivity);
KERNEL_EXPORT int lti_get_fmu_state(Lti *lti, void **state);
KERNEL_EXPORT int lti_set_fmu_state(Lti *lti, const void *state);
KERNEL_EXPORT int lti_free_fmu_state(Lti *lti, void **state);
KERNEL_EXPORT int lti_get_real(Lti *lti, const uint32_t *references, size_t n, double *values);
KERNEL_EXPORT int lti_set_real(Lti *lti, const uint32_t *references, size_t n, const double *values);

/* Nonlinear blocks and delays, with the signatures of FMI 2.0. */
KERNEL_EXPORT int block_setup(Element *e, int tolerance_given, double tolerance, double start, int stop_given,
                              double stop);
KERNEL_EXPORT int block_nothing(Element *e);
KERNEL_EXPORT void block_free(Element *e);
KERNEL_EXPORT int block_set_time(Element *e, double time);
KERNEL_EXPORT int block_set_states(Element *e, const double *x, size_t n);
KERNEL_EXPORT int block_get_states(Element *e, double *x, size_t n);
KERNEL_EXPORT int block_get_derivatives(Element *e, double *dx, size_t n);
KERNEL_EXPORT int block_get_indicators(Element *e, double *z, size_t n);
KERNEL_EXPORT int block_enter_event_mode(Element *e);
KERNEL_EXPORT int block_enter_continuous_mode(Element *e);
KERNEL_EXPORT int block_update(Element *e, LtiEventInfo *info);
KERNEL_EXPORT int block_completed_step(Element *e, int never_back, int *event, int *terminate);
KERNEL_EXPORT int block_get_directional(Element *e, const uint32_t *unknowns, size_t n_unknowns,
                                        const uint32_t *knowns, size_t n_knowns, const double *seed,
                                        double *sensitivity);
KERNEL_EXPORT int block_get_fmu_state(Element *e, void **state);
KERNEL_EXPORT int block_set_fmu_state(Element *e, const void *state);
KERNEL_EXPORT int block_free_fmu_state(Element *e, void **state);
KERNEL_EXPORT int block_get_real(Element *e, const uint32_t *references, size_t n, double *values);
KERNEL_EXPORT int block_set_real(Element *e, const uint32_t *references, size_t n, const double *values);

#endif
