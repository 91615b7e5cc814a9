/* A unit of flexlab: its instances, variables and states. What moves it is in world.c or law.c. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "unit.h"

enum { WHOLE = 2 };
typedef struct { int64_t place, settable; double low, high; } Variable;
typedef struct { int64_t in_words, place, function; } Call;      /* Where the address of a function goes. */

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
    if (unit->log) unit->say(unit, sentence);
    return REFUSED;
}

Unit *unit_new(const char *name, const char *token, void *environment, void (*log)(void), Say say) {
    Unit *unit = calloc(1, sizeof *unit);
    if (!unit) return NULL;
    unit->environment = environment, unit->log = log, unit->say = say;
    unit->name = calloc(strlen(name) + 1, 1);
    if (!unit->name || strcmp(token, TOKEN) != 0) {
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

/* Kernels call one another by addresses: as words of `advance`, and as numbers among a law's gains. */
static void place_functions(Unit *unit) {
    for (int k = 0; k < CALL_COUNT; k++) {
        int64_t address = (int64_t)(intptr_t)functions[calls[k].function];
        double number = (double)address;
        if (calls[k].in_words) unit->words[calls[k].place] = address;
        else memcpy(unit->memory + calls[k].place, &number, sizeof number);
    }
}

/* Among the words of a kernel gravity and seed are numbers; what an importer sets is part of the state. */
static void take_numbers(Unit *unit) {
    memcpy(unit->words + WORD_GRAVITY, unit->memory + AT_GRAVITY, sizeof *unit->words);
    unit->words[WORD_SEED] = (int64_t)*(double *)(unit->memory + AT_SEED);
}

void unit_reset(Unit *unit) {
    memcpy(unit->memory, flexlab_data + AT_OWN, OWN_SIZE);
    place_functions(unit);
    take_numbers(unit);
}

int unit_observe(Unit *unit) {
    return look(unit) == 0 ? DONE : unit_refuse(unit, "These values cannot be simulated.");
}

int unit_begin(Unit *unit, double start_time) {
    if (start_time != 0) return unit_refuse(unit, "This unit begins at t = 0 s: choose the start time 0.");
    return DONE;
}

static const char *reason(int64_t code) {
    if (code == UNREACHABLE) return "an arm left its workspace";
    if (code == SINGULAR) return "an arm is stretched or folded";
    if (code == BENT) return "the beam's deflection passed its length, where the linear beam model means nothing";
    return "a state is no longer a finite number";
}

double unit_time(const Unit *unit) { return ((const State *)unit->memory)->tick * TICK_PERIOD; }

int unit_step(Unit *unit, double time, double step, double *reached) {
    State *state = state_of(unit);
    char text[300];
    double ticks = floor(step / TICK_PERIOD + 0.5), now = unit_time(unit);
    *reached = now;
    if (state->stopped) return unit_refuse(unit, "This unit has stopped: reset it.");
    /* Importers that add up their steps end with one as short as what rounding has left: there is nothing to do in it. */
    if (!(step > 0) || fabs(step - ticks * TICK_PERIOD) > 1e-6 * TICK_PERIOD) {
        snprintf(text, sizeof text, "The communication step %.12g s is no whole number of this unit's ticks of %.12g s: "
                 "choose a multiple of it.", step, (double)TICK_PERIOD);
        return unit_refuse(unit, text);
    }
    if (fabs(time - now) > 1e-3 * TICK_PERIOD) {
        snprintf(text, sizeof text, "The communication point t = %.12g s is not where this unit stands, t = %.12g s.", time, now);
        return unit_refuse(unit, text);
    }
    int64_t code = go(unit, (int64_t)ticks);
    *reached = state->time = unit_time(unit);
    if (code == 0) return DONE;
    state->stopped = 1;
    snprintf(text, sizeof text, "The run stopped just after t = %.6g s: %s. The last good state is kept.", *reached, reason(code));
    return unit_refuse(unit, text);
}

int unit_get(Unit *unit, const uint32_t references[], size_t count, double values[]) {
    for (size_t k = 0; k < count; k++) {
        if (references[k] >= VARIABLE_COUNT) return unit_refuse(unit, "There is no variable with this value reference.");
        memcpy(values + k, unit->memory + variables[references[k]].place, sizeof *values);
    }
    return DONE;
}

int unit_set(Unit *unit, const uint32_t references[], size_t count, const double values[]) {
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

int unit_get_state(Unit *unit, void **state) {
    return unit_read_state(unit, unit->memory, STATE_SIZE, state);
}

int unit_set_state(Unit *unit, const void *state) {
    if (!state) return unit_refuse(unit, "There is no state to go back to.");
    memcpy(unit->memory, state, STATE_SIZE);
    place_functions(unit); /* Of another process, they were elsewhere. */
    take_numbers(unit);
    *(double *)(unit->memory + AT_DESIRED_TIME) = NAN; /* The desired motion in the scratch arrays is another instant's. */
    return DONE;
}

int unit_read_state(Unit *unit, const unsigned char bytes[], size_t size, void **state) {
    if (size != STATE_SIZE) return unit_refuse(unit, "These bytes are no state of this unit.");
    if (!*state) *state = malloc(STATE_SIZE);
    if (!*state) return unit_refuse(unit, "There is no memory left for a state.");
    memcpy(*state, bytes, STATE_SIZE);
    return DONE;
}

int unit_write_state(Unit *unit, const void *state, unsigned char bytes[], size_t size) {
    if (!state || size < STATE_SIZE) return unit_refuse(unit, "There is no room for a state.");
    memcpy(bytes, state, STATE_SIZE);
    return DONE;
}
