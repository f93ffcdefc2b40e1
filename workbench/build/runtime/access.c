/* access.c: getting and setting variables, states and derivatives (see instance.h).
 *
 * What may be set in which state: FMI 2.0.4, section 3.2.3 and 4.2.4 (the tables of allowed calls with
 * their footnotes); FMI 3.0.2, section 2.3 agrees.
 */
#include "instance.h"

#include <float.h>
#include <math.h>

static const char *const type_names[] = {"Real", "Integer", "Boolean", "Enumeration"};
static const char *const causality_names[] = {"input",  "output", "parameter", "calculated parameter",
                                              "local", "independent"};
static const char *const variability_names[] = {"constant", "fixed", "tunable", "discrete", "continuous"};

static bool is_exact(const VariableInfo *info)
{
    bool parameter = info->causality == CAUSALITY_PARAMETER; /* exact where nothing is said */
    return info->initial == INITIAL_EXACT || (parameter && info->initial == INITIAL_NONE);
}

static bool is_tunable_parameter(const VariableInfo *info)
{
    return info->causality == CAUSALITY_PARAMETER && info->variability == VARIABILITY_TUNABLE;
}

bool access_can_set(const Instance *instance, unsigned reference)
{
    const VariableInfo *info = &model_info.variables[reference];
    bool input = info->causality == CAUSALITY_INPUT;
    if (info->variability == VARIABILITY_CONSTANT || info->causality == CAUSALITY_INDEPENDENT) {
        return false;
    }
    switch (instance_state(instance)) {
    case STATE_INSTANTIATED:
        return input || is_exact(info) || info->initial == INITIAL_APPROX;
    case STATE_INITIALISATION:
        return input || is_exact(info);
    case STATE_EVENT:
    case STATE_STEP:
        return input || is_tunable_parameter(info);
    case STATE_CONTINUOUS:
        return input && info->variability == VARIABILITY_CONTINUOUS;
    case STATE_STEP_FAILED:
    case STATE_INTERMEDIATE:
    case STATE_TERMINATED:
    case STATE_ERROR:
    default:
        return false;
    }
}

static Status check_variable(Instance *instance, unsigned reference, VariableType type)
{
    if (reference >= model_info.n_variables) {
        return instance_fail(instance, "there is no variable with value reference %u", reference);
    }
    unsigned present = model_info.variables[reference].type;
    bool enumeration_as_integer = instance->fmi == 2 && type == TYPE_INTEGER && present == TYPE_ENUMERATION;
    if (present != (unsigned)type && !enumeration_as_integer) {
        return instance_fail(instance, "variable '%s' (value reference %u) is of type %s, not %s",
                             model_info.names[reference], reference, type_names[present], type_names[type]);
    }
    return STATUS_OK;
}

/* Inputs set at a communication point may start an event; it is made before a value is looked at.
 * Without a new input, values there are left limits. */
Status access_settle(Instance *instance)
{
    if (instance_state(instance) != STATE_STEP || instance->record.touched == 0.0 || instance->event_mode_used) {
        return STATUS_OK;
    }
    return communicate_handle_event(instance) ? STATUS_OK : STATUS_ERROR;
}

Status access_read(Instance *instance, unsigned reference, VariableType type, double *value)
{
    Status status = check_variable(instance, reference, type);
    if (status != STATUS_OK) {
        return status;
    }
    if (!core_get(instance->core, reference, value)) {
        instance_log(instance, CATEGORY_DISCARD, "variable '%s' has no value", model_info.names[reference]);
        return instance_core_failed(instance);
    }
    return STATUS_OK;
}

static Status refuse_setting(Instance *instance, unsigned reference)
{
    const VariableInfo *info = &model_info.variables[reference];
    return instance_fail(instance, "variable '%s' (%s %s) must not be set in state %s", model_info.names[reference],
                         variability_names[info->variability], causality_names[info->causality],
                         instance_state_name(instance));
}

/* A Real outside its range is suspicious, a whole number outside may index past a table. */
static Status check_range(Instance *instance, unsigned reference, VariableType type, double value)
{
    double lowest = model_info.minimum[reference];
    double highest = model_info.maximum[reference];
    const char *name = model_info.names[reference];
    if (value >= lowest && value <= highest) {
        return STATUS_OK;
    }
    if (type != TYPE_REAL) {
        return instance_fail(instance, "variable '%s': %.17g is outside %.17g ... %.17g", name, value, lowest, highest);
    }
    instance_log(instance, CATEGORY_WARNING, "variable '%s': %.17g is outside %.17g ... %.17g", name, value, lowest,
                 highest);
    return STATUS_OK;
}

/* In Co-Simulation a new input may start an event; a model without discrete parts or delays has none. */
static void note_change(Instance *instance)
{
    bool hybrid = model_info.n_relations > 0 || model_info.n_memory > 0 || model_info.n_indicators > 0
        || model_info.has_time_events;
    if (instance_state(instance) == STATE_STEP && hybrid) {
        instance->record.event_due = 1.0;
        instance->record.touched = 1.0;
    }
}

Status access_write(Instance *instance, unsigned reference, VariableType type, double value)
{
    Status status = check_variable(instance, reference, type);
    if (status != STATUS_OK) {
        return status;
    }
    if (!access_can_set(instance, reference)) {
        return refuse_setting(instance, reference);
    }
    if (!isfinite(value)) {
        return instance_fail(instance, "variable '%s' must be finite", model_info.names[reference]);
    }
    status = check_range(instance, reference, type, value);
    if (status == STATUS_OK) {
        core_set(instance->core, reference, value);
        note_change(instance);
    }
    return status;
}

/* ---- states ---- */

static Status check_length(Instance *instance, const void *values, size_t given, size_t expected)
{
    if (given != expected) {
        return instance_fail(instance, "%zu values given, the model has %zu", given, expected);
    }
    return expected > 0 && instance_missing(instance, values, "of the values") ? STATUS_ERROR : STATUS_OK;
}

Status access_states(Instance *instance, double *x, size_t n)
{
    Status status = check_length(instance, x, n, model_info.n_states);
    if (status == STATUS_OK && n > 0) {
        core_get_states(instance->core, x);
    }
    return status;
}

Status access_set_states(Instance *instance, const double *x, size_t n)
{
    Status status = check_length(instance, x, n, model_info.n_states);
    for (size_t i = 0; status == STATUS_OK && i < n; i++) {
        if (!isfinite(x[i])) { /* an integrator that went astray may come back with a smaller step */
            instance_log(instance, CATEGORY_DISCARD, "state '%s' is not finite",
                         model_info.names[model_info.states[i]]);
            return STATUS_DISCARD;
        }
    }
    if (status == STATUS_OK && n > 0) {
        core_set_states(instance->core, x);
    }
    return status;
}

Status access_derivatives(Instance *instance, double *dx, size_t n)
{
    Status status = check_length(instance, dx, n, model_info.n_states);
    if (status == STATUS_OK && n > 0 && !core_get_derivatives(instance->core, dx)) {
        return instance_core_failed(instance);
    }
    return status;
}

/* An indicator that is exactly 0 at an event would be lost: it has not changed its domain, and an
 * integrator that starts at 0 does not see it leave. So the domain left behind reaches a little over 0:
 * where an indicator changes its sign, the relation behind it has changed, and none is 0 at a restart
 * (FMI 2.0.4, section 3.2.2, asks for that). */
#define OVERLAP 1e-13

static double side_of(double z)
{
    return z > 0.0 ? 1.0 : -1.0;
}

void access_remember_sides(Instance *instance)
{
    bool known = core_get_indicators(instance->core, instance->sides);
    for (size_t i = 0; i < model_info.n_indicators; i++) {
        instance->sides[i] = known ? side_of(instance->sides[i]) : 0.0;
    }
}

static void widen_domains(const Instance *instance, double *z)
{
    bool frozen = instance_state(instance) == STATE_CONTINUOUS;
    for (size_t i = 0; i < model_info.n_indicators; i++) {
        bool known = frozen && instance->sides[i] != 0.0;
        z[i] += OVERLAP * (known ? instance->sides[i] : side_of(z[i]));
    }
}

Status access_indicators(Instance *instance, double *z, size_t n)
{
    Status status = check_length(instance, z, n, model_info.n_indicators);
    if (status != STATUS_OK || n == 0) {
        return status;
    }
    if (!core_get_indicators(instance->core, z)) {
        return instance_core_failed(instance);
    }
    widen_domains(instance, z);
    return STATUS_OK;
}

Status access_nominals(Instance *instance, double *nominals, size_t n)
{
    Status status = check_length(instance, nominals, n, model_info.n_states);
    for (size_t i = 0; status == STATUS_OK && i < n; i++) {
        double nominal = fabs(model_info.state_nominals[i]);
        nominals[i] = nominal > 0.0 ? nominal : 1.0;
    }
    return status;
}

Status access_set_time(Instance *instance, double time)
{
    if (!isfinite(time)) {
        return instance_fail(instance, "the time is not finite");
    }
    core_set_time(instance->core, time);
    return STATUS_OK;
}

/* ---- derivatives ---- */

static bool is_real(unsigned reference)
{
    return reference < model_info.n_variables && model_info.variables[reference].type == TYPE_REAL;
}

static bool is_known(const Instance *instance, unsigned reference)
{
    if (!is_real(reference)) {
        return false;
    }
    const VariableInfo *info = &model_info.variables[reference];
    bool initial = instance_state(instance) == STATE_INITIALISATION && is_exact(info);
    return info->causality == CAUSALITY_INPUT || info->role == ROLE_STATE || is_tunable_parameter(info) || initial;
}

static bool is_unknown(unsigned reference)
{
    if (!is_real(reference)) {
        return false;
    }
    const VariableInfo *info = &model_info.variables[reference];
    return info->causality == CAUSALITY_OUTPUT || info->causality == CAUSALITY_LOCAL;
}

static Status refuse_partial(Instance *instance, unsigned reference, const char *what)
{
    const char *name = reference < model_info.n_variables ? model_info.names[reference] : "?";
    return instance_fail(instance, "variable '%s' (value reference %u) is no %s", name, reference, what);
}

Status access_directional(Instance *instance, const unsigned *unknowns, size_t n_unknowns, const unsigned *knowns,
                          size_t n_knowns, const double *seed, double *sensitivity)
{
    for (size_t i = 0; i < n_unknowns; i++) {
        if (!is_unknown(unknowns[i])) {
            return refuse_partial(instance, unknowns[i], "continuous output, derivative or local variable");
        }
    }
    for (size_t i = 0; i < n_knowns; i++) {
        if (!is_known(instance, knowns[i])) {
            return refuse_partial(instance, knowns[i], "input, continuous state or tunable parameter");
        }
    }
    if (n_unknowns > 0
        && !core_directional(instance->core, unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity)) {
        return instance_core_failed(instance);
    }
    return STATUS_OK;
}

Status access_input_derivative(Instance *instance, unsigned reference, int order, double value)
{
    Status status = check_variable(instance, reference, TYPE_REAL);
    if (status != STATUS_OK) {
        return status;
    }
    InputPolynomial *polynomial = inputs_find(&instance->inputs, reference);
    if (polynomial == NULL) {
        return instance_fail(instance, "variable '%s' is no continuous input", model_info.names[reference]);
    }
    if (order < 1 || order > INPUT_MAX_ORDER || !isfinite(value)) {
        return instance_fail(instance, "input '%s': derivatives of order 1 to %d with finite values are accepted",
                             model_info.names[reference], INPUT_MAX_ORDER);
    }
    inputs_set_derivative(polynomial, (size_t)order, value);
    return STATUS_OK;
}

static Status add_partial(Instance *instance, unsigned output, unsigned known, double slope, double *sum)
{
    double partial = 0.0;
    if (slope == 0.0) {
        return STATUS_OK;
    }
    if (!core_directional(instance->core, &output, 1, &known, 1, &slope, &partial)) {
        return instance_core_failed(instance);
    }
    *sum += partial;
    return STATUS_OK;
}

static Status add_state_part(Instance *instance, unsigned output, double *sum)
{
    for (size_t i = 0; i < model_info.n_states; i++) {
        double slope = 0.0;
        if (!core_get(instance->core, model_info.derivatives[i], &slope)) {
            return instance_core_failed(instance);
        }
        Status status = add_partial(instance, output, model_info.states[i], slope, sum);
        if (status != STATUS_OK) {
            return status;
        }
    }
    return STATUS_OK;
}

static Status add_input_part(Instance *instance, unsigned output, double *sum)
{
    double now = core_time(instance->core);
    for (size_t i = 0; i < instance->inputs.n; i++) {
        double slope = inputs_slope(&instance->inputs.polynomials[i], now);
        Status status = add_partial(instance, output, instance->inputs.references[i], slope, sum);
        if (status != STATUS_OK) {
            return status;
        }
    }
    return STATUS_OK;
}

/* Explicit dependence on time is no partial derivative the core knows: a central difference, exactly
 * 0 where there is none. */
static Status add_time_part(Instance *instance, unsigned output, double *sum)
{
    double now = core_time(instance->core);
    double distance = 1e-5 * fmax(1.0, fabs(now));
    double before = 0.0;
    double after = 0.0;
    core_set_time(instance->core, now - distance);
    bool good = core_get(instance->core, output, &before);
    core_set_time(instance->core, now + distance);
    good = core_get(instance->core, output, &after) && good;
    core_set_time(instance->core, now);
    *sum += (after - before) / (2.0 * distance);
    return good ? STATUS_OK : instance_core_failed(instance);
}

Status access_output_derivative(Instance *instance, unsigned reference, int order, double *value)
{
    Status status = check_variable(instance, reference, TYPE_REAL);
    if (status != STATUS_OK) {
        return status;
    }
    const VariableInfo *info = &model_info.variables[reference];
    if (info->causality != CAUSALITY_OUTPUT || order < 1) {
        return instance_fail(instance, "variable '%s': derivatives of order 1 and more of outputs can be asked for",
                             model_info.names[reference]);
    }
    *value = 0.0;
    if (order > 1 || info->variability != VARIABILITY_CONTINUOUS) {
        return STATUS_OK; /* FMI: what is not known is 0 */
    }
    status = add_state_part(instance, reference, value);
    status = status == STATUS_OK ? add_input_part(instance, reference, value) : status;
    return status == STATUS_OK ? add_time_part(instance, reference, value) : status;
}
