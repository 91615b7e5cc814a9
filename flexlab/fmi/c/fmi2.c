/* The functions of FMI 2.0, co-simulation (https://fmi-standard.org). */
#include <stddef.h>
#include "unit.h"

typedef void (*Logger)(void *environment, const char *name, int status, const char *category, const char *message, ...);
typedef struct {
    Logger log;
    void *(*allocate)(size_t count, size_t size);
    void (*release)(void *memory);
    void (*finished)(void *environment, int status);
    void *environment;
} Callbacks;
enum { CO_SIMULATION = 1, LAST_SUCCESSFUL_TIME };

static void say(Unit *unit, const char *sentence) {
    ((Logger)unit->log)(unit->environment, unit->name, REFUSED, "logStatusError", "%s", sentence);
}

EXPORT const char *fmi2GetTypesPlatform(void) { return "default"; }
EXPORT const char *fmi2GetVersion(void) { return "2.0"; }
EXPORT int fmi2SetDebugLogging(Unit *unit, int on, size_t count, const char *const categories[]) {
    (void)unit, (void)on, (void)count, (void)categories;
    return DONE;
}

EXPORT Unit *fmi2Instantiate(const char *name, int type, const char *token, const char *resources, const Callbacks *callbacks,
                             int visible, int logging) {
    (void)resources, (void)visible, (void)logging;
    if (type != CO_SIMULATION) return NULL;
    void *environment = callbacks ? callbacks->environment : NULL;
    return unit_new(name, token, environment, callbacks ? (void (*)(void))callbacks->log : NULL, say);
}
EXPORT void fmi2FreeInstance(Unit *unit) { unit_free(unit); }

EXPORT int fmi2SetupExperiment(Unit *unit, int has_tolerance, double tolerance, double start, int has_stop, double stop) {
    (void)has_tolerance, (void)tolerance, (void)has_stop, (void)stop;
    return unit_set_up(unit, start);
}
EXPORT int fmi2EnterInitializationMode(Unit *unit) { return unit_enter(unit); }
EXPORT int fmi2ExitInitializationMode(Unit *unit) { return unit_exit(unit); }
EXPORT int fmi2Terminate(Unit *unit) { return unit_end(unit); }
EXPORT int fmi2Reset(Unit *unit) { return unit_reset(unit); }

EXPORT int fmi2DoStep(Unit *unit, double time, double step, int no_going_back) {
    double reached;
    (void)no_going_back;
    return unit_step(unit, time, step, &reached);
}
EXPORT int fmi2GetRealStatus(Unit *unit, int kind, double *value) {
    if (kind != LAST_SUCCESSFUL_TIME) return unit_refuse(unit, "This unit does not offer this status.");
    return unit_last_time(unit, value);
}

EXPORT int fmi2GetReal(Unit *unit, const uint32_t references[], size_t count, double values[]) {
    return unit_get(unit, references, count, values);
}
EXPORT int fmi2SetReal(Unit *unit, const uint32_t references[], size_t count, const double values[]) {
    return unit_set(unit, references, count, values);
}

EXPORT int fmi2GetFMUstate(Unit *unit, void **state) { return unit_get_state(unit, state); }
EXPORT int fmi2SetFMUstate(Unit *unit, void *state) { return unit_set_state(unit, state); }
EXPORT int fmi2FreeFMUstate(Unit *unit, void **state) { return unit_free_state(unit, state); }
EXPORT int fmi2SerializedFMUstateSize(Unit *unit, void *state, size_t *size) { return unit_state_size(unit, state, size); }
EXPORT int fmi2SerializeFMUstate(Unit *unit, void *state, unsigned char bytes[], size_t size) {
    return unit_write_state(unit, state, bytes, size);
}
EXPORT int fmi2DeSerializeFMUstate(Unit *unit, const unsigned char bytes[], size_t size, void **state) {
    return unit_read_state(unit, bytes, size, state);
}

ABSENT(fmi2GetInteger) ABSENT(fmi2GetBoolean) ABSENT(fmi2GetString)
ABSENT(fmi2SetInteger) ABSENT(fmi2SetBoolean) ABSENT(fmi2SetString)
ABSENT(fmi2GetDirectionalDerivative) ABSENT(fmi2SetRealInputDerivatives) ABSENT(fmi2GetRealOutputDerivatives)
ABSENT(fmi2CancelStep) ABSENT(fmi2GetStatus) ABSENT(fmi2GetIntegerStatus) ABSENT(fmi2GetBooleanStatus)
ABSENT(fmi2GetStringStatus)
