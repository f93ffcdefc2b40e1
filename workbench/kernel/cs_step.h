/* cs_step.h: one communication step: inputs, doStep, early returns, events. */
#ifndef WORKBENCH_KERNEL_CS_STEP_H
#define WORKBENCH_KERNEL_CS_STEP_H

#include "cs.h"

/* Set the right limits; jumps and discrete inputs need event mode where there is one. */
bool cs_set_inputs(Cs *cs, bool jump);
/* Step every FMU to `end`, going on after early returns and handling events on the way. */
bool cs_step_to(Cs *cs, double end);

#endif
