/* inputs.c: polynomial inputs (see inputs.h). */
#include "inputs.h"

static bool is_continuous_input(size_t reference)
{
    const VariableInfo *info = &model_info.variables[reference];
    return info->causality == CAUSALITY_INPUT && info->type == TYPE_REAL
        && info->variability == VARIABILITY_CONTINUOUS;
}

static size_t count_inputs(void)
{
    size_t n = 0;
    for (size_t i = 0; i < model_info.n_variables; i++) {
        n += is_continuous_input(i) ? 1U : 0U;
    }
    return n;
}

static void list_references(Inputs *inputs)
{
    size_t n = 0;
    for (size_t i = 0; i < model_info.n_variables; i++) {
        if (is_continuous_input(i)) {
            inputs->references[n++] = (unsigned)i;
        }
    }
}

bool inputs_new(Inputs *inputs, const Memory *memory)
{
    inputs->n = count_inputs();
    inputs->any_active = false;
    inputs->references = memory_new(memory, inputs->n, sizeof(unsigned));
    inputs->polynomials = memory_new(memory, inputs->n, sizeof(InputPolynomial));
    if (inputs->references == NULL || inputs->polynomials == NULL) {
        inputs_free(inputs, memory);
        return false;
    }
    list_references(inputs);
    return true;
}

void inputs_free(Inputs *inputs, const Memory *memory)
{
    memory_delete(memory, inputs->references);
    memory_delete(memory, inputs->polynomials);
    inputs->references = NULL;
    inputs->polynomials = NULL;
}

void inputs_clear(Inputs *inputs)
{
    memset(inputs->polynomials, 0, inputs->n * sizeof(InputPolynomial));
    inputs->any_active = false;
}

InputPolynomial *inputs_find(Inputs *inputs, unsigned reference)
{
    for (size_t i = 0; i < inputs->n; i++) {
        if (inputs->references[i] == reference) {
            return &inputs->polynomials[i];
        }
    }
    return NULL;
}

void inputs_set_derivative(InputPolynomial *polynomial, size_t order, double value)
{
    if (polynomial->fresh == 0.0) { /* the first one for this step: the last step's are over */
        memset(polynomial, 0, sizeof *polynomial);
    }
    polynomial->fresh = 1.0;
    polynomial->derivative[order - 1] = value;
}

static bool begin_one(InputPolynomial *polynomial, Core *core, unsigned reference, double origin)
{
    if (polynomial->fresh == 0.0) {
        memset(polynomial, 0, sizeof *polynomial);
        return true;
    }
    polynomial->fresh = 0.0;
    polynomial->origin = origin;
    for (size_t k = 0; k < INPUT_MAX_ORDER; k++) {
        polynomial->active = polynomial->derivative[k] != 0.0 ? 1.0 : polynomial->active;
    }
    return core_get(core, reference, &polynomial->value);
}

bool inputs_begin(Inputs *inputs, Core *core, double origin)
{
    bool good = true;
    inputs->any_active = false;
    for (size_t i = 0; i < inputs->n; i++) {
        good = begin_one(&inputs->polynomials[i], core, inputs->references[i], origin) && good;
        inputs->any_active = inputs->any_active || inputs->polynomials[i].active != 0.0;
    }
    return good;
}

void inputs_end(Inputs *inputs)
{
    inputs->any_active = false; /* from here on the importer's values count, not the polynomial */
}

static double evaluate(const InputPolynomial *p, double elapsed)
{
    double cubic = p->derivative[1] / 2.0 + elapsed * p->derivative[2] / 6.0;
    return p->value + elapsed * (p->derivative[0] + elapsed * cubic);
}

void inputs_apply(const Inputs *inputs, Core *core, double time)
{
    if (!inputs->any_active) {
        return;
    }
    for (size_t i = 0; i < inputs->n; i++) {
        const InputPolynomial *p = &inputs->polynomials[i];
        if (p->active != 0.0) {
            core_set(core, inputs->references[i], evaluate(p, time - p->origin));
        }
    }
}

double inputs_slope(const InputPolynomial *p, double time)
{
    if (p->fresh != 0.0) { /* set at this very point for the step to come */
        return p->derivative[0];
    }
    double elapsed = time - p->origin;
    return p->derivative[0] + elapsed * (p->derivative[1] + elapsed * p->derivative[2] / 2.0);
}
