/* cs_step.h: one communication step: inputs, doStep, early returns, events. */
#ifndef WORKBENCH_KERNEL_CS_STEP_H
#define WORKBENCH_KERNEL_CS_STEP_H

#include "cs.h"

/* Where the way to `target` is interrupted by what is known to happen in a component [s]. */
double cs_next_stop(const Cs *cs, double target);
/* Gather when something is due after now; what rounding alone puts later is of now. */
void cs_gather(const Cs *cs, Gathered *next, double due);
/* Look where the inputs go until `end`, and tell those FMUs that can take it; fills `seen` of the forcing. */
void cs_look_ahead(Cs *cs, double end);
/* Set the right limits; jumps and discrete inputs need event mode where there is one. */
bool cs_set_inputs(Cs *cs, bool jump);
/* Whether an input moves from `before`, by more than rounding; NaN: it is not known what it was. */
bool input_moves(double before, double now);
/* After a row was read: let the FMUs see once more how their inputs move here, from `seen` of the forcing. Some (of
 * Dymola 2023x) integrate on as if no input had moved where they were asked for a value since. */
bool cs_announce(Cs *cs);
/* Step every FMU to `end`, going on after early returns and handling events on the way. */
bool cs_step_to(Cs *cs, double end);

#endif
