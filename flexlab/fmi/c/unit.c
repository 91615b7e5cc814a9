/* A unit of flexlab: its instances, variables and states. world.c or law.c advances it. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "unit.h"

enum { WHOLE = 2 };
static const double LONGEST = 1e9; /* s: the longest communication step. */
typedef struct { int64_t place, settable; double low, high; } Variable;
typedef struct { int64_t in_words, place, function; } Call;      /* Where a function's address is stored. */

extern void FUNCTIONS;
static void (*const functions[])(void) = {FUNCTION_NAMES};

const int64_t *const words = (const int64_t *)(flexlab_data + AT_WORDS);
const int64_t *const kinds = (const int64_t *)(flexlab_data + AT_KINDS);
static const Variable *const variables = (const Variable *)(flexlab_data + AT_VARIABLES);
static const Call *const calls = (const Call *)(flexlab_data + AT_CALLS);

int64_t located(Unit *unit, int64_t kind, int64_t value) {
    if (kind == OWN) return (int64_t)(intptr_t)(unit->memory + value);
    if (kind == SHARED) return (int64_t)(intptr_t)(flexlab_data + AT_SHARED + value);
    return value;
}

int unit_refuse(Unit *unit, const char *sentence) {
    if (unit && unit->log) unit->say(unit, sentence);
    return REFUSED;
}

Unit *unit_new(const char *name, const char *token, void *environment, void (*log)(void), Say say) {
    Unit *unit = calloc(1, sizeof *unit);
    if (!unit) return NULL;
    unit->environment = environment, unit->log = log, unit->say = say;
    if (!name) name = "";
    unit->name = calloc(strlen(name) + 1, 1);
    if (!unit->name || !token || strcmp(token, TOKEN) != 0) {
        unit_refuse(unit, "The model description and the binary of this unit belong to different exports.");
        unit_free(unit);
        return NULL;
    }
    strcpy(unit->name, name);
    for (int k = 0; k < WORD_COUNT; k++) unit->words[k] = located(unit, kinds[k], words[k]);
    unit_reset(unit);
    return unit;
}

void unit_free(Unit *unit) {
    if (unit) free(unit->name);
    free(unit);
}

/* Kernels call one another by address. Addresses are words of `advance`, or numbers among a law's gains. */
static void place_functions(Unit *unit) {
    for (int k = 0; k < CALL_COUNT; k++) {
        int64_t address = (int64_t)(intptr_t)functions[calls[k].function];
        double number = (double)address;
        if (calls[k].in_words) unit->words[calls[k].place] = address;
        else memcpy(unit->memory + calls[k].place, &number, sizeof number);
    }
}

/* Importers set gravity and seed in the state; the kernel takes them as numbers among its words. */
static void take_numbers(Unit *unit) {
    memcpy(unit->words + WORD_GRAVITY, unit->memory + AT_GRAVITY, sizeof *unit->words);
    unit->words[WORD_SEED] = (int64_t)*(double *)(unit->memory + AT_SEED);
}

int unit_reset(Unit *unit) {
    if (!unit) return REFUSED;
    memcpy(unit->memory, flexlab_data + AT_OWN, OWN_SIZE);
    place_functions(unit);
    take_numbers(unit);
    return DONE;
}

static int is_in(Unit *unit, int64_t phase) { return unit && state_of(unit)->phase == phase; }

int unit_set_up(Unit *unit, double start_time) {
    if (!is_in(unit, INSTANTIATED)) return unit_refuse(unit, "This unit has begun: reset it before it is set up again.");
    if (start_time != 0) return unit_refuse(unit, "This unit begins at t = 0 s: choose the start time 0.");
    return DONE;
}

int unit_enter(Unit *unit) {
    if (!is_in(unit, INSTANTIATED)) return unit_refuse(unit, "This unit has begun: reset it before it is initialized again.");
    state_of(unit)->phase = INITIALIZING;
    return DONE;
}

int unit_exit(Unit *unit) {
    if (!is_in(unit, INITIALIZING))
        return unit_refuse(unit, "This unit is not being initialized: enter initialization mode first.");
    if (look(unit) != 0) return unit_refuse(unit, "These values cannot be simulated.");
    state_of(unit)->phase = RUNNING;
    return DONE;
}

int unit_end(Unit *unit) {
    if (!is_in(unit, RUNNING) && !is_in(unit, STOPPED))
        return unit_refuse(unit, "This unit does not run: there is nothing to terminate.");
    state_of(unit)->phase = TERMINATED;
    return DONE;
}

static const char *reason(int64_t code) {
    if (code == UNREACHABLE) return "an arm left its workspace";
    if (code == SINGULAR) return "an arm is stretched or folded";
    if (code == BENT) return "the beam's deflection passed its length, where the linear beam model means nothing";
    return "a state is no longer a finite number";
}

double unit_time(const Unit *unit) { return ((const State *)unit->memory)->tick * TICK_PERIOD; }

int unit_last_time(Unit *unit, double *value) {
    if (!unit) return REFUSED;
    *value = unit_time(unit);
    return DONE;
}

int unit_step(Unit *unit, double time, double step, double *reached) {
    if (!unit) return REFUSED;
    State *state = state_of(unit);
    char text[300];
    double ticks = floor(step / TICK_PERIOD + 0.5), now = unit_time(unit);
    *reached = now;
    if (state->phase == STOPPED) return unit_refuse(unit, "This unit has stopped: reset it.");
    if (state->phase == TERMINATED) return unit_refuse(unit, "This unit was terminated: reset it.");
    if (state->phase != RUNNING)
        return unit_refuse(unit, "This unit is not initialized: enter and exit initialization mode before the first step.");
    /* Importers that add up their steps may end with one as short as the rounding error, in which there is nothing to do. */
    if (!(step > 0 && step <= LONGEST) || fabs(step - ticks * TICK_PERIOD) > 1e-6 * TICK_PERIOD) {
        snprintf(text, sizeof text, "The communication step %.12g s is not a whole number of this unit's ticks of %.12g s: "
                 "choose a multiple of it, up to %g s.", step, (double)TICK_PERIOD, (double)LONGEST);
        return unit_refuse(unit, text);
    }
    if (!(fabs(time - now) <= 1e-3 * TICK_PERIOD)) {
        snprintf(text, sizeof text, "The communication point t = %.12g s is not this unit's present time, t = %.12g s.", time, now);
        return unit_refuse(unit, text);
    }
    int64_t code = go(unit, (int64_t)ticks);
    *reached = state->time = unit_time(unit);
    if (code == 0) return DONE;
    state->phase = STOPPED;
    snprintf(text, sizeof text, "The run stopped just after t = %.6g s: %s. The last good state is kept.", *reached, reason(code));
    return unit_refuse(unit, text);
}

static int read(Unit *unit, const uint32_t references[], size_t count, double values[]) {
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= VARIABLE_COUNT) return unit_refuse(unit, "There is no variable with this value reference.");
        memcpy(values + k, unit->memory + variables[references[k]].place, sizeof *values);
    }
    return DONE;
}

int unit_get(Unit *unit, const uint32_t references[], size_t count, double values[]) {
    if (!unit) return REFUSED;
    if (state_of(unit)->phase > INITIALIZING) return read(unit, references, count, values);
    /* Until the run begins, outputs follow from the settings; computing them must not begin the run. */
    unsigned char *before = malloc(OWN_SIZE);
    if (!before) return unit_refuse(unit, "There is no memory left to compute the outputs.");
    memcpy(before, unit->memory, OWN_SIZE);
    int status = look(unit) == 0 ? read(unit, references, count, values) : unit_refuse(unit, "These values cannot be simulated.");
    memcpy(unit->memory, before, OWN_SIZE);
    free(before);
    return status;
}

int unit_set(Unit *unit, const uint32_t references[], size_t count, const double values[]) {
    if (!unit) return REFUSED;
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= VARIABLE_COUNT || !variables[references[k]].settable)
            return unit_refuse(unit, "A variable with this value reference cannot be set.");
        if (!isfinite(values[k])) return unit_refuse(unit, "An input is not a finite number.");
        if (values[k] < variables[references[k]].low || values[k] > variables[references[k]].high)
            return unit_refuse(unit, "A parameter is out of its range: see min and max in the model description.");
        if (variables[references[k]].settable == WHOLE && values[k] != floor(values[k]))
            return unit_refuse(unit, "A seed is a whole number.");
        memcpy(unit->memory + variables[references[k]].place, values + k, sizeof *values);
    }
    take_numbers(unit);
    return DONE;
}

static int keep(Unit *unit, const unsigned char bytes[], void **state) {
    if (!*state) *state = malloc(STATE_SIZE);
    if (!*state) return unit_refuse(unit, "There is no memory left for a state.");
    memcpy(*state, bytes, STATE_SIZE);
    return DONE;
}

int unit_get_state(Unit *unit, void **state) { return unit ? keep(unit, unit->memory, state) : REFUSED; }

int unit_set_state(Unit *unit, const void *state) {
    if (!unit || !state) return unit_refuse(unit, "There is no state to go back to.");
    memcpy(unit->memory, state, STATE_SIZE);
    place_functions(unit); /* A state from another process holds other addresses. */
    take_numbers(unit);
    *(double *)(unit->memory + AT_DESIRED_TIME) = NAN; /* The scratch arrays hold the desired motion of another instant. */
    return DONE;
}

/* FNV-1a: kernels trust the counts in a state, which a damaged file could change. */
static uint64_t checksum(const unsigned char *state) {
    uint64_t sum = 0xcbf29ce484222325u;
    for (size_t k = 0; k < STATE_SIZE; k++) sum = (sum ^ state[k]) * 0x100000001b3u;
    return sum;
}

/* A serialized state begins with the unit's token and a checksum. */
enum { AT_SUM = sizeof TOKEN, AT_STATE = AT_SUM + sizeof(uint64_t), STATE_BYTES = AT_STATE + STATE_SIZE };

int unit_free_state(Unit *unit, void **state) {
    (void)unit;
    if (state) free(*state), *state = NULL;
    return DONE;
}

int unit_state_size(Unit *unit, const void *state, size_t *size) {
    (void)unit, (void)state;
    *size = STATE_BYTES;
    return DONE;
}

int unit_read_state(Unit *unit, const unsigned char bytes[], size_t size, void **state) {
    uint64_t sum;
    if (!bytes || size != STATE_BYTES || memcmp(bytes, TOKEN, sizeof TOKEN) != 0)
        return unit_refuse(unit, "These bytes are no state of this unit.");
    memcpy(&sum, bytes + AT_SUM, sizeof sum);
    if (sum != checksum(bytes + AT_STATE)) return unit_refuse(unit, "The bytes of this state are damaged.");
    return keep(unit, bytes + AT_STATE, state);
}

int unit_write_state(Unit *unit, const void *state, unsigned char bytes[], size_t size) {
    if (!state || size < STATE_BYTES) return unit_refuse(unit, "There is no room for a state.");
    uint64_t sum = checksum(state);
    memcpy(bytes, TOKEN, sizeof TOKEN);
    memcpy(bytes + AT_SUM, &sum, sizeof sum);
    memcpy(bytes + AT_STATE, state, STATE_SIZE);
    return DONE;
}
