/* A world that advances by whole ticks as in flexlab/sim/stepping.py, with the same machine code. */
#include <math.h>
#include <string.h>
#include "unit.h"

typedef struct { int64_t level, tick; double begin, length, end; int64_t count, scheme; } Piece;

extern int32_t flexlab_advance(const int64_t *words, int64_t *returned);

static const int64_t *const schemes = (const int64_t *)(flexlab_data + AT_SCHEMES);
static const Piece *const pieces = (const Piece *)(flexlab_data + AT_PIECES);

/* A law's measurements besides the pose: the rates of the beam's moments, as `advance` left them, and the gauges' strains. */
static void read_sensors(Unit *unit) {
    const double *eta = (const double *)(unit->memory + AT_Y) + FIRST_MODE;
    const double *strain = (const double *)(flexlab_data + AT_SHARED + AT_STRAIN);
    double *sensors = (double *)(unit->memory + AT_SENSORS);
    memcpy(sensors, unit->memory + AT_BEAM_RATE, 2 * sizeof *sensors);
    for (int j = 0; j < GAUGES; j++) {
        double total = 0;
        for (int k = 0; k < MODES; k++) total += strain[j * MODES + k] * eta[k];
        sensors[2 + j] = total;
    }
}

/* One call of `advance` for `count` ticks; returns the ticks done and its code. */
static int64_t advance(Unit *unit, int64_t count, int64_t *code) {
    int64_t returned[2] = {0, NOT_A_NUMBER};
    unit->words[WORD_ROWS_SIZE] = count * ROW_LENGTH;
    unit->words[WORD_ROWS_SHAPE] = count;
    flexlab_advance(unit->words, returned);
    *code = returned[1];
    int64_t sampled = returned[0] + unit->words[WORD_PRESENT];
    if (sampled > 0) {
        memcpy(unit->memory + AT_ROW, unit->memory + AT_ROWS + (sampled - 1) * ROW_LENGTH * 8, ROW_LENGTH * 8);
        read_sensors(unit);
    }
    return returned[0];
}

static void take_scheme(Unit *unit, int64_t number) {
    for (int k = 0; k < SCHEME_WORDS; k++)
        unit->words[WORD_SCHEME + k] = located(unit, kinds[WORD_SCHEME + k], schemes[number * SCHEME_WORDS + k]);
}

/* Prepares whole ticks from the present one, with steps of the present level. */
static void set_out(Unit *unit) {
    const State *state = state_of(unit);
    take_scheme(unit, state->level);
    unit->words[WORD_SAMPLING_STEPS] = words[WORD_SAMPLING_STEPS] << state->level;
    unit->words[WORD_MOST] = words[WORD_MOST];
    unit->words[WORD_LEVEL] = state->level;
    unit->words[WORD_ORIGIN] = bits(0.0);
    unit->words[WORD_TICK] = state->tick;
    unit->words[WORD_PERIOD] = bits(TICK_PERIOD);
    unit->words[WORD_STEP_COUNT] = words[WORD_STEP_COUNT] << state->level;
    unit->words[WORD_PRESENT] = 0;
}

/* The first piece of the next tick, from `tick` on, that is split into pieces; NULL if there is none. Pieces are sorted. */
static const Piece *next_piece(int64_t level, int64_t tick) {
    for (int k = 0; k < PIECE_COUNT; k++)
        if (pieces[k].level == level && pieces[k].tick >= tick) return &pieces[k];
    return NULL;
}

/* Advances one tick in pieces, as flexlab/sim/step_levels.py does; returns the code of `advance`. */
static int64_t go_in_pieces(Unit *unit, const Piece *piece) {
    double *y = (double *)(unit->memory + AT_Y), before = y[SINCE], start[STATE_LENGTH];
    int64_t code = 0, tick = piece->tick, level = piece->level;
    double end = piece->end;
    memcpy(start, y, sizeof start);
    set_out(unit);
    unit->words[WORD_SAMPLING_STEPS] = words[WORD_SAMPLING_STEPS];
    for (; piece < pieces + PIECE_COUNT && piece->tick == tick && piece->level == level; piece++) {
        if (COUNTS_TICKS) y[SINCE] = before;
        take_scheme(unit, piece->scheme);
        unit->words[WORD_ORIGIN] = bits(piece->begin);
        unit->words[WORD_TICK] = 0;
        unit->words[WORD_PERIOD] = bits(piece->length);
        unit->words[WORD_STEP_COUNT] = piece->count;
        advance(unit, 1, &code);
        if (code != 0) {
            memcpy(y, start, sizeof start);
            return code;
        }
        unit->words[WORD_MOST] = unit->words[WORD_LEVEL] = 0;
        end = piece->end;
    }
    memcpy(unit->memory + AT_ROW, &end, sizeof end); /* The row begins with the time. */
    return 0;
}

/* Advances `count` ticks; returns a fault code. */
int64_t go(Unit *unit, int64_t count) {
    State *state = state_of(unit);
    int64_t code = 0, goal = state->tick + count;
    if (AT_GIVEN) { /* The given motion is for this instant. */
        *(double *)(unit->memory + AT_GIVEN) = unit_time(unit);
        *(double *)(unit->memory + AT_DESIRED_TIME) = NAN;
    }
    while (state->tick < goal) {
        const Piece *piece = next_piece(state->level, state->tick);
        if (piece && piece->tick == state->tick) {
            code = go_in_pieces(unit, piece);
            if (code == 0) state->tick++;
        } else {
            int64_t end = piece && piece->tick < goal ? piece->tick : goal, most = state->tick + BLOCK;
            set_out(unit);
            state->tick += advance(unit, (end < most ? end : most) - state->tick, &code);
        }
        if (code >= OTHER_STEP) state->level = code - OTHER_STEP;
        else if (code != 0) return code;
    }
    return 0;
}

#if FIRST_COUNT
extern int32_t flexlab_first(const int64_t *words, int64_t *returned);

/* A sampled law acts at the start. */
static int64_t act_first(Unit *unit) {
    const int64_t *numbers = (const int64_t *)(flexlab_data + AT_FIRST);
    int64_t given[FIRST_COUNT], code = NOT_A_NUMBER;
    for (int k = 0; k < FIRST_COUNT; k++) given[k] = unit->words[numbers[k]];
    flexlab_first(given, &code);
    return code;
}
#else
static int64_t act_first(Unit *unit) { (void)unit; return 0; }
#endif

int64_t look(Unit *unit) {
    *(double *)(unit->memory + AT_DESIRED_TIME) = NAN; /* An importer may have set another desired motion. */
    set_out(unit);
    int64_t code = act_first(unit);
    if (code != 0) return code;
    unit->words[WORD_PRESENT] = 1;
    advance(unit, 1, &code);
    return code >= OTHER_STEP ? 0 : code;
}
