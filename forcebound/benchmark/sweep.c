/* The limit of the sweep: forcebound/sweep/kernel.py in C, for the certified law, the elastic wall
 * and the pressing hand. Same layout, same order of operations: with -ffp-contract=off it gives
 * the same bits. The constants have the rows of kernel.py; the others are its own.
 */
#include <math.h>
#include <stdint.h>

#ifndef WIDTH
#error "compile with -DWIDTH=..., the WIDTH of kernel.py"
#endif

enum { MASS, HAND_MASS, DAMPING, FRICTION, RESOLUTION, SATURATION, HAND_STIFFNESS, HAND_DAMPING,
       LAW, ENVIRONMENT = 14, OPERATOR = 18, CONSTANTS = 21,
       INERTIA = 21, IMPEDANCE, X, V, WORK, TARGET, TARGET_VELOCITY, READING, SAMPLE, VELOCITY,
       PLAY, PATH, FORCE, STATE, OLDER, YOUNGER, VISCOUS, BETWEEN, ROWS };

enum { ANCHOR_SAMPLES = 8 }; /* bounding/sample.py */

enum { COLUMNS = 6 };

#define AT(row) s[(row) * WIDTH + i]
#define LANES for (int i = 0; i < WIDTH; i++)

static inline double smaller(double a, double b) { return b < a ? b : a; }
static inline double larger(double a, double b) { return b > a ? b : a; }

static inline double clear_square(double reading, double anchor, double half_resolution)
{
    double clear = larger(fabs(reading - anchor) - 2.0 * half_resolution, 0.0);
    return clear * clear;
}

static inline double pressing_target(double elapsed, double start, double end, double speed)
{
    double travel = speed * elapsed;
    double on_way = end > start ? start + travel : start - travel;
    return travel >= fabs(end - start) ? end : on_way;
}

static inline double quantise(double x, double resolution)
{
    double reading = floor(x / resolution + 0.5) * resolution;
    return resolution <= 0.0 ? x : reading;
}

static int64_t count_steps(double duration, double substep)
{
    double steps = ceil(duration / substep - 1e-9);
    return steps < 1.0 ? 1 : (int64_t)steps;
}

static void move(double *restrict s, double duration, int64_t steps, double elapsed)
{
    LANES {
        double end = pressing_target(elapsed, AT(OPERATOR), AT(OPERATOR + 1), AT(OPERATOR + 2));
        AT(TARGET_VELOCITY) = (end - AT(TARGET)) / duration;
    }
    double h = duration / steps;
    LANES {
        double inertia = 2.0 * AT(MASS) / h;
        AT(INERTIA) = inertia;
        AT(IMPEDANCE) = inertia + AT(DAMPING) + AT(HAND_DAMPING) + 0.5 * h * AT(HAND_STIFFNESS);
    }
    for (int64_t n = 0; n < steps; n++) {
        double middle = n + 0.5;
        LANES {
            double target_velocity = AT(TARGET_VELOCITY);
            double target_middle = AT(TARGET) + target_velocity * middle * h;
            double x = AT(X), v = AT(V), friction = AT(FRICTION);
            double drive = AT(INERTIA) * v + AT(HAND_STIFFNESS) * (target_middle - x)
                + AT(HAND_DAMPING) * target_velocity - AT(FORCE);
            double mean = (drive - smaller(larger(drive, -friction), friction)) / AT(IMPEDANCE);
            double end = 2.0 * mean - v;
            double dx = h * mean;
            double muscle = AT(HAND_STIFFNESS) * (target_middle - x - 0.5 * dx)
                + AT(HAND_DAMPING) * (target_velocity - mean);
            AT(X) = x + dx;
            AT(V) = end * mean > 0.0 ? end : 0.0;
            AT(WORK) = AT(WORK) + muscle * dx;
        }
    }
    LANES AT(TARGET) += AT(TARGET_VELOCITY) * duration;
}

void run(int64_t ticks, int64_t period_ns, int64_t wait_ns, double substep, double cutoff,
         const int64_t *restrict answered, const double *restrict engagement, double *restrict s,
         double *restrict answers, int64_t answers_rows, double *restrict traces)
{
    double to_sample = (period_ns - wait_ns) * 1e-9;
    double to_write = wait_ns * 1e-9;
    int64_t steps_to_sample = count_steps(to_sample, substep);
    int64_t steps_to_write = count_steps(to_write, substep);
    double since_sample = period_ns * 1e-9;
    double angle = 2.0 * M_PI * cutoff * since_sample;
    double share = angle / (1.0 + angle);
    double elapsed = period_ns / 1e9;
    int64_t last = answers_rows - 1;
    double older_age = 0.0, younger_age = 0.0;
    int since_anchor = 0;

    LANES {
        for (int row = CONSTANTS; row < ROWS; row++)
            AT(row) = 0.0;
        double target = pressing_target(0.0, AT(OPERATOR), AT(OPERATOR + 1), AT(OPERATOR + 2));
        AT(TARGET) = AT(X) = target;
        AT(SAMPLE) = quantise(target, AT(RESOLUTION));
    }
    for (int64_t k = 0; k < ticks; k++) {
        /* The sample. */
        if (k > 0)
            move(s, to_sample, steps_to_sample, k * period_ns * 1e-9);
        double *restrict now = answers + (k & last) * WIDTH;
        LANES {
            double sample = quantise(AT(X), AT(RESOLUTION));
            double measured = (sample - AT(SAMPLE)) / since_sample;
            AT(VELOCITY) = AT(VELOCITY) + share * (measured - AT(VELOCITY));
            AT(SAMPLE) = sample;
            now[i] = AT(ENVIRONMENT) * larger(sample - AT(ENVIRONMENT + 1), 0.0);
        }
        /* The write. */
        if (wait_ns > 0)
            move(s, to_write, steps_to_write, (k * period_ns + wait_ns) * 1e-9);
        double *restrict out = traces + k * COLUMNS * WIDTH;
        LANES {
            double commanded = answers[(answered[k * WIDTH + i] & last) * WIDTH + i];
            double saturation = AT(SATURATION), scale = engagement[k * WIDTH + i];
            double magnitude = fabs(commanded);
            double shortened = saturation / magnitude;
            scale = magnitude > saturation ? scale * shortened : scale;
            out[WIDTH + i] = commanded * scale;
        }
        if (k > 0) {
            older_age += elapsed;
            younger_age += elapsed;
            since_anchor++;
        }
        int moves_anchors = since_anchor == ANCHOR_SAMPLES;
        LANES {
            double commanded = out[WIDTH + i], saturation = AT(SATURATION);
            double damping = AT(LAW), friction = AT(LAW + 1), half_resolution = AT(LAW + 2);
            double hold_limit = AT(LAW + 4), axes = AT(LAW + 5);
            double reading = quantise(AT(X), AT(RESOLUTION));
            double held = AT(FORCE), magnitude = fabs(held);
            double state, playing, gone, force;
            if (k == 0) {
                state = -friction * half_resolution * sqrt(axes);
                playing = reading;
                gone = force = 0.0;
                AT(OLDER) = AT(YOUNGER) = reading;
            } else {
                double moved = reading - AT(READING);
                double before = AT(VISCOUS), between = AT(BETWEEN);
                double viscous = before
                    + clear_square(reading, AT(READING), half_resolution) / elapsed;
                viscous = larger(viscous, clear_square(reading, AT(OLDER), half_resolution)
                                          / older_age);
                viscous = larger(viscous, between
                                 + clear_square(reading, AT(YOUNGER), half_resolution)
                                   / younger_age);
                playing = larger(reading - half_resolution,
                                 smaller(reading + half_resolution, AT(PLAY)));
                gone = AT(PATH) + fabs(playing - AT(PLAY));
                /* certified.py: limit */
                double stiffness = damping / hold_limit;
                double excess = larger(magnitude - friction, 0.0);
                double blind = excess * excess * hold_limit / (4.0 * damping);
                double square = larger(held * held, 1e-30), work = held * moved;
                double clear = larger(fabs(moved) - 2.0 * half_resolution * sqrt(axes), 0.0);
                double share = 0.5 - 2.0 * damping * work / (square * elapsed);
                share = smaller(larger(share, 0.0), hold_limit / elapsed);
                double seeing = share * (1.0 - share) * held * held * elapsed / (4.0 * damping);
                seeing -= share * work + damping * clear * clear / elapsed;
                double cut = AT(STATE) - smaller(blind, seeing);
                cut -= half_resolution * magnitude + friction * half_resolution * sqrt(axes);
                double kept = AT(STATE) + damping * (viscous - before)
                    + friction * (gone - AT(PATH)) + held * moved;
                int is_cut = elapsed > hold_limit;
                state = is_cut ? cut : kept;
                double surplus = larger(is_cut ? cut : kept - half_resolution * magnitude, 0.0);
                double largest = friction + 2.0 * sqrt(stiffness * surplus);
                largest = smaller(largest, saturation);
                force = smaller(larger(commanded, -largest), largest);
                double younger = AT(YOUNGER);
                AT(OLDER) = moves_anchors ? younger : AT(OLDER);
                AT(YOUNGER) = moves_anchors ? reading : younger;
                viscous = moves_anchors ? viscous - between : viscous;
                AT(BETWEEN) = moves_anchors ? viscous : between;
                AT(VISCOUS) = viscous;
            }
            AT(STATE) = state - half_resolution * fabs(force - held);
            AT(READING) = reading;
            AT(PLAY) = playing;
            AT(PATH) = gone;
            AT(FORCE) = force;
        }
        if (moves_anchors) {
            older_age = younger_age;
            younger_age = 0.0;
            since_anchor = 0;
        }
        LANES {
            double force = AT(FORCE), v = AT(V);
            out[i] = AT(READING);
            out[2 * WIDTH + i] = force;
            out[3 * WIDTH + i] = AT(STATE) - AT(LAW + 2) * fabs(force);
            out[4 * WIDTH + i] = AT(WORK) - 0.5 * AT(HAND_MASS) * v * v;
            out[5 * WIDTH + i] = AT(X);
        }
    }
}
