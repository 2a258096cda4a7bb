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
       /* DeviceConstants, bounding/sample.py */
       LAW_DAMPING, LAW_FRICTION, HALF_RESOLUTION, PERIOD, HOLD_LIMIT, AXES, PATH_FRICTION,
       START_PRICE, ENERGY_CAP,
       ENVIRONMENT, OPERATOR = ENVIRONMENT + 4, CONSTANTS = OPERATOR + 3,
       INERTIA = CONSTANTS, IMPEDANCE, X, V, WORK, TARGET, TARGET_VELOCITY, SAMPLE, VELOCITY,
       STATE, ENERGY, READING, FORCE, MEAN, PLAY, WAY, OLDER, YOUNGER, PATH, LOSS, BETWEEN, WANTED,
       ROWS };

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

/* The first reading; no force is held. */
static void start(double *restrict s)
{
    LANES {
        AT(READING) = AT(PLAY) = AT(OLDER) = AT(YOUNGER) = quantise(AT(X), AT(RESOLUTION));
        AT(STATE) = AT(ENERGY) = -AT(START_PRICE);
    }
}

/* bounding/one_axis.py; the ages of the anchors, in s, count up to this sample. */
static void bound(double *restrict s, double dt, double older_age, double younger_age,
                  int moves_anchors)
{
    LANES {
        double damping = AT(LAW_DAMPING), friction = AT(LAW_FRICTION), r = AT(HALF_RESOLUTION);
        double held = AT(FORCE), younger = AT(YOUNGER), between = AT(BETWEEN);
        double reading = quantise(AT(X), AT(RESOLUTION));
        /* sample.py: observe_axis, observe */
        double position = larger(reading - r, smaller(reading + r, AT(PLAY)));
        double moved = fabs(position - AT(PLAY));
        double way = AT(WAY) + moved;
        double path = sqrt(way * way);
        double loss = AT(LOSS) + damping * clear_square(reading, AT(READING), r) / dt;
        loss = larger(loss, damping * clear_square(reading, AT(OLDER), r) / older_age);
        loss = larger(loss, between + damping * clear_square(reading, younger, r) / younger_age);
        double friction_loss = friction * moved + AT(PATH_FRICTION) * (path - AT(PATH));
        double price = r * fabs(held);
        /* certified.py: limit, energy */
        double ledger = AT(STATE) - r * fabs(held - AT(MEAN));
        ledger += loss - AT(LOSS) + friction_loss + held * (reading - AT(READING));
        double state = smaller(ledger, AT(ENERGY_CAP) + price);
        double energy = state - price;
        /* hold_cost.py: rigid_force */
        double largest = friction + 2.0 * sqrt(damping / AT(HOLD_LIMIT) * larger(energy, 0.0));
        largest = smaller(largest, AT(SATURATION));
        AT(FORCE) = smaller(larger(AT(WANTED), -largest), largest);
        AT(STATE) = state;
        AT(ENERGY) = energy;
        AT(READING) = reading;
        AT(MEAN) = held;
        AT(PLAY) = position;
        AT(WAY) = way;
        AT(PATH) = path;
        AT(OLDER) = moves_anchors ? younger : AT(OLDER);
        AT(YOUNGER) = moves_anchors ? reading : younger;
        AT(LOSS) = moves_anchors ? loss - between : loss;
        AT(BETWEEN) = moves_anchors ? loss - between : between;
    }
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
    double dt = period_ns / 1e9;
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
            double scale = engagement[k * WIDTH + i];
            double force = answers[(answered[k * WIDTH + i] & last) * WIDTH + i] * scale;
            double largest = AT(SATURATION) * scale, magnitude = fabs(force);
            double shortened = largest / magnitude * force;
            out[WIDTH + i] = force;
            AT(WANTED) = magnitude > largest ? shortened : force;
        }
        if (k == 0) {
            start(s);
        } else {
            older_age += dt;
            younger_age += dt;
            int moves_anchors = ++since_anchor == ANCHOR_SAMPLES;
            bound(s, dt, older_age, younger_age, moves_anchors);
            if (moves_anchors) {
                older_age = younger_age;
                younger_age = 0.0;
                since_anchor = 0;
            }
        }
        LANES {
            double v = AT(V);
            out[i] = AT(READING);
            out[2 * WIDTH + i] = AT(FORCE);
            out[3 * WIDTH + i] = AT(ENERGY);
            out[4 * WIDTH + i] = AT(WORK) - 0.5 * AT(HAND_MASS) * v * v;
            out[5 * WIDTH + i] = AT(X);
        }
    }
}
