#include "failure.h"

bool fail_at(Failure *failure, FailureCode code, double time) {
    if (failure->code == NO_FAILURE) {
        failure->code = (int32_t)code;
        failure->time = time;
    }
    return false;
}

bool fail_of(Failure *failure, FailureCode code, double time, int32_t component) {
    if (failure->code == NO_FAILURE) {
        failure->component = component;
    }
    return fail_at(failure, code, time);
}

bool fail_value(Failure *failure, FailureCode code, double time, size_t index, double value) {
    if (failure->code == NO_FAILURE) {
        failure->index = (int64_t)index;
        failure->value = value;
    }
    return fail_at(failure, code, time);
}

void failure_clear(Failure *failure) {
    failure->code = NO_FAILURE;
    failure->status = 0;
    failure->component = 0;
    failure->function = -1;
    failure->index = 0;
    failure->value = 0.0;
    failure->name = NULL;
    failure->message[0] = '\0';
}
