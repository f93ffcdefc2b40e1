/* instance.c: life, state machine and log of an instance (see instance.h). */
#include "instance.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>

#define MESSAGE_SIZE 1024

typedef struct {
    unsigned bit;
    const char *fmi2;
    const char *fmi3;
} StateName;

static const StateName state_names[] = {
    {STATE_INSTANTIATED, "instantiated", "Instantiated"},
    {STATE_INITIALISATION, "Initialization Mode", "Initialization Mode"},
    {STATE_EVENT, "Event Mode", "Event Mode"},
    {STATE_CONTINUOUS, "Continuous-Time Mode", "Continuous-Time Mode"},
    {STATE_STEP, "stepComplete", "Step Mode"},
    {STATE_STEP_FAILED, "stepFailed", "Step Mode"},
    {STATE_INTERMEDIATE, "intermediate update", "Intermediate Update Mode"},
    {STATE_TERMINATED, "terminated", "Terminated"},
    {STATE_ERROR, "error", "Terminated"},
};

static const struct {
    Category bit;
    const char *name;
} category_names[] = {
    {CATEGORY_EVENTS, "logEvents"},
    {CATEGORY_WARNING, "logStatusWarning"},
    {CATEGORY_DISCARD, "logStatusDiscard"},
    {CATEGORY_ERROR, "logStatusError"},
    {CATEGORY_ALL, "logAll"},
};

#define COUNT(array) (sizeof(array) / sizeof((array)[0]))

State instance_state(const Instance *instance)
{
    return (State)(int)instance->record.state;
}

bool instance_can_be(const Instance *instance, double state)
{
    unsigned states = STATE_INSTANTIATED | STATE_INITIALISATION | STATE_TERMINATED;
    states |= instance->fmi == 2 ? STATE_ERROR : 0;
    states |= instance->kind == KIND_ME ? STATE_EVENT | STATE_CONTINUOUS : STATE_STEP;
    states |= instance->kind == KIND_CS && instance->fmi == 2 ? STATE_STEP_FAILED : 0;
    states |= instance->event_mode_used ? STATE_EVENT : 0;
    for (unsigned bit = STATE_INSTANTIATED; bit <= STATE_ERROR; bit *= 2) {
        if ((states & bit) != 0U && state >= (double)bit && state <= (double)bit) {
            return true;
        }
    }
    return false;
}

void instance_set_state(Instance *instance, State state)
{
    instance->record.state = (double)state;
}

static const char *name_of(const Instance *instance, size_t i)
{
    return instance->fmi == 2 ? state_names[i].fmi2 : state_names[i].fmi3;
}

const char *instance_state_name(const Instance *instance)
{
    for (size_t i = 0; i < COUNT(state_names); i++) {
        if (state_names[i].bit == (unsigned)instance_state(instance)) {
            return name_of(instance, i);
        }
    }
    return "unknown";
}

/* ---- log ---- */

static const char *category_name(Category category)
{
    for (size_t i = 0; i < COUNT(category_names); i++) {
        if (category_names[i].bit == category) {
            return category_names[i].name;
        }
    }
    return "logAll";
}

static Status status_of(Category category)
{
    switch (category) {
    case CATEGORY_ERROR:
        return STATUS_ERROR;
    case CATEGORY_DISCARD:
        return STATUS_DISCARD;
    case CATEGORY_WARNING:
        return STATUS_WARNING;
    case CATEGORY_EVENTS:
    case CATEGORY_ALL:
    default:
        return STATUS_OK;
    }
}

static bool wanted(const Instance *instance, Category category)
{
    bool always = instance->fmi == 2 && category == CATEGORY_ERROR;
    return instance->logger != NULL && (always || (instance->categories & (unsigned)category) != 0U);
}

static void log_list(const Instance *instance, Category category, const char *format, va_list arguments)
{
    char text[MESSAGE_SIZE];
    int used = snprintf(text, sizeof text, "%s: ", instance->call);
    if (used > 0 && (size_t)used < sizeof text) {
        vsnprintf(text + used, sizeof text - (size_t)used, format, arguments);
    }
    instance->emit(instance, status_of(category), category_name(category), text);
}

void instance_log(Instance *instance, Category category, const char *format, ...)
{
    if (!wanted(instance, category)) {
        return;
    }
    va_list arguments;
    va_start(arguments, format);
    log_list(instance, category, format, arguments);
    va_end(arguments);
}

static State state_after_error(const Instance *instance)
{
    return instance->fmi == 2 ? STATE_ERROR : STATE_TERMINATED;
}

Status instance_fail(Instance *instance, const char *format, ...)
{
    if (wanted(instance, CATEGORY_ERROR)) {
        va_list arguments;
        va_start(arguments, format);
        log_list(instance, CATEGORY_ERROR, format, arguments);
        va_end(arguments);
    }
    instance_set_state(instance, state_after_error(instance));
    return STATUS_ERROR;
}

static void log_from_core(void *environment, bool is_error, const char *message)
{
    Instance *instance = environment;
    if (instance->muted) {
        snprintf(instance->kept, sizeof instance->kept, "%s", message);
        return;
    }
    instance_log(instance, is_error ? CATEGORY_ERROR : CATEGORY_EVENTS, "%s", message);
}

Status instance_core_failed(Instance *instance)
{
    if (instance_state(instance) == STATE_CONTINUOUS) {
        instance_log(instance, CATEGORY_DISCARD, "no value at t = %.17g", core_time(instance->core));
        return STATUS_DISCARD;
    }
    return instance_fail(instance, "the model cannot be evaluated at t = %.17g", core_time(instance->core));
}

static bool find_category(const char *name, unsigned *bits)
{
    for (size_t i = 0; name != NULL && i < COUNT(category_names); i++) {
        if (strcmp(name, category_names[i].name) == 0) {
            *bits |= (unsigned)category_names[i].bit;
            return true;
        }
    }
    return false;
}

Status instance_set_logging(Instance *instance, bool on, size_t n, const char *const *categories)
{
    unsigned bits = on && n == 0 ? CATEGORY_ALL : 0U;
    if (n > 0 && instance_missing(instance, categories, "categories")) {
        return STATUS_ERROR;
    }
    for (size_t i = 0; i < n; i++) {
        if (!find_category(categories[i], &bits)) {
            return instance_fail(instance, "unknown log category '%s'", categories[i] != NULL ? categories[i] : "");
        }
    }
    /* FMI 2.0: with loggingOn false the listed categories are switched off. */
    bool some_off = instance->fmi == 2 && !on && n > 0;
    instance->categories = some_off ? instance->categories & ~bits : (on ? bits : 0U);
    return STATUS_OK;
}

bool instance_missing(Instance *instance, const void *argument, const char *name)
{
    if (argument == NULL) {
        instance_fail(instance, "argument %s is a null pointer", name);
    }
    return argument == NULL;
}

/* ---- birth and death ---- */

static bool same_token(const char *given)
{
    return given != NULL && strcmp(given, model_info.token) == 0;
}

static bool blank(const char *text)
{
    return text == NULL || text[strspn(text, " \t\r\n")] == '\0';
}

static void clear_record(Instance *instance)
{
    memset(&instance->record, 0, sizeof instance->record);
    instance->record.stop_time = HUGE_VAL;
    instance->record.next_event_time = HUGE_VAL;
    flights_forget(&instance->record.flights);
    instance_set_state(instance, STATE_INSTANTIATED);
}

static bool build(Instance *instance, const char *name)
{
    size_t length = strlen(name) + 1;
    instance->name = memory_new(&instance->memory, length, 1);
    instance->sides = memory_new(&instance->memory, model_info.n_indicators, sizeof(double));
    instance->turned = memory_new(&instance->memory, turned_doubles(), sizeof(double));
    instance->core = core_new(log_from_core, instance);
    if (instance->name == NULL || instance->sides == NULL || instance->turned == NULL || instance->core == NULL
        || !inputs_new(&instance->inputs, &instance->memory)) {
        return false;
    }
    memcpy(instance->name, name, length);
    if (instance->kind == KIND_CS) {
        instance->solver = solver_new(instance->core, &instance->inputs, &instance->memory);
    }
    return instance->kind != KIND_CS || instance->solver != NULL;
}

/* What cannot be told about an instance that does not exist yet is told by a provisional one. */
static Instance *refuse(Instance *provisional, const char *reason)
{
    instance_fail(provisional, "%s", reason);
    return NULL;
}

static void fill(Instance *instance, const Birth *birth, const char *call)
{
    instance->fmi = birth->fmi;
    instance->kind = birth->kind;
    instance->memory = birth->memory;
    instance->call = call;
    instance->categories = birth->logging ? CATEGORY_ALL : 0U;
    instance->emit = birth->emit;
    instance->logger = birth->logger;
    instance->environment = birth->environment;
    clear_record(instance);
}

Instance *instance_new(const Birth *birth, const char *call)
{
    Instance provisional;
    char unnamed[] = "(unnamed)";
    memset(&provisional, 0, sizeof provisional);
    fill(&provisional, birth, call);
    provisional.name = unnamed;
    if (blank(birth->name)) {
        return refuse(&provisional, "the instance name is empty");
    }
    if (!same_token(birth->token)) {
        return refuse(&provisional, birth->fmi == 2 ? "the GUID is not that of this model"
                                                    : "the instantiation token is not that of this model");
    }
    Instance *instance = memory_new(&birth->memory, 1, sizeof *instance);
    if (instance == NULL) {
        return refuse(&provisional, "out of memory");
    }
    fill(instance, birth, call);
    if (!build(instance, birth->name)) {
        instance_free(instance);
        return refuse(&provisional, "out of memory");
    }
    return instance;
}

void instance_free(Instance *instance)
{
    if (instance == NULL) {
        return;
    }
    Memory memory = instance->memory;
    solver_free(instance->solver);
    inputs_free(&instance->inputs, &memory);
    if (instance->core != NULL) {
        core_free(instance->core);
    }
    memory_delete(&memory, instance->name);
    memory_delete(&memory, instance->sides);
    memory_delete(&memory, instance->turned);
    memory_delete(&memory, instance);
}

void instance_reset(Instance *instance)
{
    core_reset(instance->core);
    inputs_clear(&instance->inputs);
    memset(instance->sides, 0, model_info.n_indicators * sizeof(double));
    memset(instance->turned, 0, turned_doubles() * sizeof(double));
    clear_record(instance);
}

/* ---- state machine ---- */

static void list_states(const Instance *instance, unsigned states, char *text, size_t size)
{
    size_t used = 0;
    text[0] = '\0';
    for (size_t i = 0; i < COUNT(state_names) && used < size; i++) {
        if ((states & state_names[i].bit) != 0U) {
            int written = snprintf(text + used, size - used, "%s%s", used > 0 ? ", " : "", name_of(instance, i));
            used += written > 0 ? (size_t)written : 0U;
        }
    }
}

Instance *instance_enter(void *pointer, const Call *call)
{
    Instance *instance = pointer;
    if (instance == NULL) {
        return NULL;
    }
    instance->call = call->name;
    if ((call->kinds & (unsigned)instance->kind) == 0U) {
        instance_fail(instance, "not available in %s",
                      instance->kind == KIND_ME ? "Model Exchange" : "Co-Simulation");
        return NULL;
    }
    if ((call->states & (unsigned)instance_state(instance)) == 0U) {
        char allowed[256];
        list_states(instance, call->states, allowed, sizeof allowed);
        instance_fail(instance, "not allowed in state %s (allowed in: %s)", instance_state_name(instance), allowed);
        return NULL;
    }
    return instance;
}

Status instance_set_experiment(Instance *instance, bool has_tolerance, double tolerance, double start,
                               bool has_stop, double stop)
{
    if (has_tolerance && !(tolerance > 0.0 && tolerance < 1.0)) {
        return instance_fail(instance, "the tolerance %g is not between 0 and 1", tolerance);
    }
    if (!isfinite(start)) {
        return instance_fail(instance, "the start time is not finite");
    }
    if (has_stop && !(stop >= start)) {
        return instance_fail(instance, "the stop time %g is before the start time %g", stop, start);
    }
    instance->record.tolerance = has_tolerance ? tolerance : 0.0;
    instance->record.start_time = start;
    instance->record.stop_time = has_stop ? stop : HUGE_VAL;
    return STATUS_OK;
}

Status instance_enter_initialisation(Instance *instance)
{
    Record *record = &instance->record;
    if (!core_enter_initialisation(instance->core, record->start_time)) {
        return instance_core_failed(instance);
    }
    record->communication_point = record->start_time;
    record->last_successful_time = record->start_time;
    instance_set_state(instance, STATE_INITIALISATION);
    return STATUS_OK;
}

Status instance_exit_initialisation(Instance *instance)
{
    if (!core_exit_initialisation(instance->core)) {
        return instance_core_failed(instance);
    }
    bool event_mode = instance->kind == KIND_ME || instance->event_mode_used;
    instance->record.event_due = 1.0;
    if (event_mode) {
        instance_set_state(instance, STATE_EVENT);
        return STATUS_OK;
    }
    instance_set_state(instance, STATE_STEP);
    return communicate_handle_event(instance) ? STATUS_OK : STATUS_ERROR;
}

Status instance_enter_event(Instance *instance)
{
    if (instance_state(instance) != STATE_EVENT) {
        communicate_reach_event(instance);
        core_enter_event(instance->core);
    }
    instance_set_state(instance, STATE_EVENT);
    return STATUS_OK;
}

Status instance_new_discrete_states(Instance *instance, CoreEventInfo *info)
{
    memset(info, 0, sizeof *info);
    if (!core_new_discrete_states(instance->core, info)) {
        return instance_core_failed(instance);
    }
    Record *record = &instance->record;
    record->next_event_time = info->next_event_time_defined ? info->next_event_time : HUGE_VAL;
    record->event_due = info->discrete_states_need_update ? 1.0 : 0.0;
    record->touched = 0.0;
    record->terminate = info->terminate ? 1.0 : record->terminate;
    if (info->continuous_states_changed) {
        record->step = 0.0;
    }
    return STATUS_OK;
}

Status instance_leave_event(Instance *instance, State next)
{
    if (!core_enter_continuous(instance->core)) {
        return instance_core_failed(instance);
    }
    instance_set_state(instance, next);
    if (instance->kind == KIND_ME) {
        access_remember_sides(instance);
    }
    return STATUS_OK;
}
