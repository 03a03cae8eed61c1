/* kdsm/02_data.c - examples to learn from: a garment on a body in many poses, simulated by the kit.
 *
 * Notice: a chain of poses is one simulation from rest, and depends on its number alone; each is a
 * file of its own, written whole or not at all. So a run that was stopped goes on where it was, and
 * shards on many machines (GNU parallel, a Slurm array) merge to the same bytes as one run.
 *
 *   cc -std=c99 -O2 -ffp-contract=off -DCLOTHSIM_IMPLEMENTATION -I.. -I. kdsm/02_data.c -lm
 *   run:      02_data [DIRECTORY [options]]               what is made goes to DIRECTORY/data
 *             --chains N    how many; 2          --poses N    of each, settled; 2
 *             --edge M      of the shirt by formula; 0.03    --steps N   to a pose; 40
 *             --around A    poses of a walk and A of what a person can; 0: all of that alone
 *             --moves N     motions at random more, kept while they move; 0
 *             --move N      steps of each; 150
 *             --every N     steps from example to example of a motion; 12
 *             --shard I/N   only chains I, I + N, I + 2 N .. and no merging
 *             --merge       nothing but that
 *             --skeleton FILE    of the body of --on, for chains of random angles there too
 *             --on GARMENT.obj BODY.obj WEIGHTS.txt MOTION.skin ..     each motion is a chain more:
 *                           the first is to be tested, the second watches, others are learned from
 *             seq 0 3 | parallel 02_data out/shirt --chains 100 --poses 5 --shard {}/4
 *   two commands from files to a predictor, DIR/data.net:
 *             02_data DIR --chains 20 --skeleton skeleton.txt --on skirt.obj body.obj weights.txt
 *                 walk.skin jump.skin punch.skin
 *             03_learn DIR/data --on skirt.obj body.obj weights.txt walk.skin
 *                 (14 min and 2 on one core. A smallest setting: 50 of its 103 examples were thrown
 *                 out, a skirt's hem between the legs; what is predicted of poses at random is off
 *                 by 38 mm, the mean by 67; of a walk when a punch alone was learned, 123)
 *   expected: 2 examples of 2 chains, 0 thrown out
 *
 * A directory is of one garment, body and set of options: chains that are there are kept without a
 * word, whatever they were made with. Without one: one pose each of a coarse shirt, made anew in
 * out/02_data.
 * Thrown out: examples in which a vertex of cloth is over 3 mm inside of the body.
 */
#define KDSM_IMPLEMENTATION
#include "chains.h"

static const char *read_arguments(int argc, char **argv, job *j) {
    static char stem[1000];
    int         i;
    if (argc > 1) sprintf(stem, "%.900s/", argv[1]);
    *j = chains_job(argc > 1 ? stem : "out/02_");
    if (argc < 2) j->edge = 0.05, j->poses = 1;
    for (i = 2; i < argc; i++) {
        if (!strcmp(argv[i], "--merge")) j->merge = 1;
        else if (!strcmp(argv[i], "--chains") && i + 1 < argc) j->chains = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--moves") && i + 1 < argc) j->moves = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--move") && i + 1 < argc) j->move = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--poses") && i + 1 < argc) j->poses = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--steps") && i + 1 < argc) j->steps = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--around") && i + 1 < argc) j->around = atof(argv[++i]);
        else if (!strcmp(argv[i], "--every") && i + 1 < argc) j->every = atoi(argv[++i]);
        else if (!strcmp(argv[i], "--edge") && i + 1 < argc) j->edge = atof(argv[++i]);
        else if (!strcmp(argv[i], "--skeleton") && i + 1 < argc) j->skeleton = argv[++i];
        else if (!strcmp(argv[i], "--shard") && i + 1 < argc) {
            if (sscanf(argv[++i], "%d/%d", &j->shard, &j->shards) != 2 || j->shards < 1)
                return "--shard I/N, I from 0";
        } else if (!strcmp(argv[i], "--on") && i + 4 < argc) {
            j->files = argv + i + 1, j->motions = argc - i - 4;
            if (!j->skeleton) j->chains = j->moves = 0;
            break;
        } else return "an option is not known: see the head of 02_data.c";
    }
    if (j->shard < 0 || j->shard >= j->shards) return "--shard I/N: I from 0, below N";
    if (j->skeleton && !j->motions) return "--skeleton is of the body of --on";
    return chains_count(j) > 0 && j->poses > 0 && j->steps > 0 && j->every > 0 && j->move > 0 ? NULL
               : "--chains, --poses, --steps, --move and --every from 1";
}

int main(int argc, char **argv) {
    static job  j;
    const char *error = read_arguments(argc, argv, &j);
    if (!error && argc < 2) chains_forget(&j);
    if (!error && !j.merge) error = chains_dress(&j);
    if (!error && !j.merge) error = chains_make(&j);
    if (!error && (j.merge || j.shards == 1)) error = chains_merge(&j);
    if (error) fprintf(stderr, "%s\n", error);
    chains_free(&j);
    return error != NULL;
}
