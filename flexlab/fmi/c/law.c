/* A control law that acts on its sensors at each tick, as in flexlab/sim/sampled_control.py. */
#include "unit.h"

extern int32_t flexlab_answer(const int64_t *words, int64_t *returned);

int64_t look(Unit *unit) {
    int64_t code = NOT_A_NUMBER;
    unit->words[WORD_NUMBER] = state_of(unit)->tick;
    unit->words[WORD_TIME] = bits(unit_time(unit));
    flexlab_answer(unit->words, &code);
    return code;
}

int64_t go(Unit *unit, int64_t count) {
    int64_t code = 0;
    while (count-- > 0 && code == 0) {
        state_of(unit)->tick++;
        code = look(unit);
    }
    if (code != 0) state_of(unit)->tick--;
    return code;
}
