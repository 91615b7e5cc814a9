/* The functions of FMI 3.0, co-simulation (https://fmi-standard.org). */
#include <stdbool.h>
#include <stddef.h>
#include "unit.h"

typedef void (*Logger)(void *environment, int status, const char *category, const char *message);

static void say(Unit *unit, const char *sentence) { ((Logger)unit->log)(unit->environment, REFUSED, "logStatusError", sentence); }

EXPORT const char *fmi3GetVersion(void) { return "3.0"; }
EXPORT int fmi3SetDebugLogging(Unit *unit, bool on, size_t count, const char *const categories[]) {
    (void)unit, (void)on, (void)count, (void)categories;
    return DONE;
}

EXPORT Unit *fmi3InstantiateCoSimulation(const char *name, const char *token, const char *resources, bool visible, bool logging,
                                         bool event_mode, bool early_return, const uint32_t intermediate[], size_t count,
                                         void *environment, Logger log, void (*update)(void)) {
    (void)resources, (void)visible, (void)logging, (void)event_mode, (void)early_return, (void)intermediate, (void)count, (void)update;
    return unit_new(name, token, environment, (void (*)(void))log, say);
}
EXPORT void *fmi3InstantiateModelExchange(void) { return NULL; }
EXPORT void *fmi3InstantiateScheduledExecution(void) { return NULL; }
EXPORT void fmi3FreeInstance(Unit *unit) { unit_free(unit); }

EXPORT int fmi3EnterInitializationMode(Unit *unit, bool has_tolerance, double tolerance, double start, bool has_stop, double stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    int status = unit_set_up(unit, start);
    return status == DONE ? unit_enter(unit) : status;
}
EXPORT int fmi3ExitInitializationMode(Unit *unit) { return unit_exit(unit); }
EXPORT int fmi3Terminate(Unit *unit) { return unit_end(unit); }
EXPORT int fmi3Reset(Unit *unit) { return unit_reset(unit); }

EXPORT int fmi3DoStep(Unit *unit, double time, double step, bool no_going_back, bool *event, bool *terminate, bool *early,
                      double *reached) {
    (void)no_going_back;
    *event = *terminate = *early = false;
    return unit_step(unit, time, step, reached);
}

EXPORT int fmi3GetFloat64(Unit *unit, const uint32_t references[], size_t count, double values[], size_t length) {
    return length == count ? unit_get(unit, references, count, values) : unit_refuse(unit, "Every variable is one number.");
}
EXPORT int fmi3SetFloat64(Unit *unit, const uint32_t references[], size_t count, const double values[], size_t length) {
    return length == count ? unit_set(unit, references, count, values) : unit_refuse(unit, "Every variable is one number.");
}

EXPORT int fmi3GetFMUState(Unit *unit, void **state) { return unit_get_state(unit, state); }
EXPORT int fmi3SetFMUState(Unit *unit, void *state) { return unit_set_state(unit, state); }
EXPORT int fmi3FreeFMUState(Unit *unit, void **state) { return unit_free_state(unit, state); }
EXPORT int fmi3SerializedFMUStateSize(Unit *unit, void *state, size_t *size) { return unit_state_size(unit, state, size); }
EXPORT int fmi3SerializeFMUState(Unit *unit, void *state, unsigned char bytes[], size_t size) {
    return unit_write_state(unit, state, bytes, size);
}
EXPORT int fmi3DeserializeFMUState(Unit *unit, const unsigned char bytes[], size_t size, void **state) {
    return unit_read_state(unit, bytes, size, state);
}

ABSENT(fmi3EnterEventMode) ABSENT(fmi3EnterStepMode) ABSENT(fmi3EnterConfigurationMode) ABSENT(fmi3ExitConfigurationMode)
ABSENT(fmi3EnterContinuousTimeMode) ABSENT(fmi3UpdateDiscreteStates) ABSENT(fmi3EvaluateDiscreteStates)
ABSENT(fmi3GetFloat32) ABSENT(fmi3GetInt8) ABSENT(fmi3GetUInt8) ABSENT(fmi3GetInt16) ABSENT(fmi3GetUInt16)
ABSENT(fmi3GetInt32) ABSENT(fmi3GetUInt32) ABSENT(fmi3GetInt64) ABSENT(fmi3GetUInt64) ABSENT(fmi3GetBoolean)
ABSENT(fmi3GetString) ABSENT(fmi3GetBinary) ABSENT(fmi3GetClock)
ABSENT(fmi3SetFloat32) ABSENT(fmi3SetInt8) ABSENT(fmi3SetUInt8) ABSENT(fmi3SetInt16) ABSENT(fmi3SetUInt16)
ABSENT(fmi3SetInt32) ABSENT(fmi3SetUInt32) ABSENT(fmi3SetInt64) ABSENT(fmi3SetUInt64) ABSENT(fmi3SetBoolean)
ABSENT(fmi3SetString) ABSENT(fmi3SetBinary) ABSENT(fmi3SetClock)
ABSENT(fmi3GetNumberOfVariableDependencies) ABSENT(fmi3GetVariableDependencies)
ABSENT(fmi3GetDirectionalDerivative) ABSENT(fmi3GetAdjointDerivative) ABSENT(fmi3GetOutputDerivatives)
ABSENT(fmi3GetIntervalDecimal) ABSENT(fmi3GetIntervalFraction) ABSENT(fmi3GetShiftDecimal) ABSENT(fmi3GetShiftFraction)
ABSENT(fmi3SetIntervalDecimal) ABSENT(fmi3SetIntervalFraction) ABSENT(fmi3SetShiftDecimal) ABSENT(fmi3SetShiftFraction)
ABSENT(fmi3CompletedIntegratorStep) ABSENT(fmi3SetTime) ABSENT(fmi3SetContinuousStates)
ABSENT(fmi3GetContinuousStateDerivatives) ABSENT(fmi3GetEventIndicators) ABSENT(fmi3GetContinuousStates)
ABSENT(fmi3GetNominalsOfContinuousStates) ABSENT(fmi3GetNumberOfEventIndicators) ABSENT(fmi3GetNumberOfContinuousStates)
ABSENT(fmi3ActivateModelPartition)
