/* me_event.h: what happens at an event of model exchange. */
#ifndef WORKBENCH_KERNEL_ME_EVENT_H
#define WORKBENCH_KERNEL_ME_EVENT_H

#include "me.h"

/* Report an accepted step; *event: an FMU wants an event. */
bool me_completed(Me *me, bool *event);
/* Handle an event at the present time, `located` at an indicator's zero; the FMUs stand at their left limit. */
bool me_event(Me *me, bool located);
bool me_put(Me *me);
/* Let the scales grow to these states, and the span of the present flight. */
void me_note_states(Me *me, const double *x);
/* Begin as if there had been no event. */
void me_forget_events(Me *me);
bool me_restart_solver(Me *me, const double *x);

#endif
