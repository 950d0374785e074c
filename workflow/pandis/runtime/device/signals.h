/* What becomes of a run when its process is to stop, end or crash: zero goes out first. Part of client.c. */
#ifndef SIGNALS_H
#define SIGNALS_H

/* Signals of which a program ends or stops. Those of the first row are intercepted, those of the second unless the
 * program has other plans for them: the run ends with zero force, and then they are given to whom they were meant for. */
static const int client_orderly[] = {SIGINT,  SIGTERM, SIGHUP,  SIGQUIT, SIGTSTP, /* up to here always */
                                     SIGUSR1, SIGUSR2, SIGALRM, SIGXCPU, SIGTTIN, SIGTTOU, SIGVTALRM, SIGPROF};
/* Signals after which nothing can be relied on: zero goes out from within them. */
static const int client_fatal[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
enum {
    CLIENT_ALWAYS = 5,
    CLIENT_ORDERLY = sizeof client_orderly / sizeof *client_orderly,
    CLIENT_FATAL = sizeof client_fatal / sizeof *client_fatal
};
static struct sigaction client_before[CLIENT_ORDERLY + CLIENT_FATAL];

/* Switch the motors off, and let the signal do what it would have done. */
static void client_die(int number) {
    const double zero[3] = {0};
    device *d = &client.device;
    /* a frame of this very thread is ended with zero; one of another thread is not ours to touch */
    if (__atomic_load_n(&client.inside, __ATOMIC_SEQ_CST) && pthread_equal(client_ticking, pthread_self()))
        d->write(d, zero, NULL);
    d->output(d, 0);
    for (int k = 0; k < CLIENT_FATAL; k++)
        if (client_fatal[k] == number) sigaction(number, client_before + CLIENT_ORDERLY + k, NULL);
    raise(number);
}

static void client_intercept(void) {
    struct sigaction note, die;
    memset(&note, 0, sizeof note), memset(&die, 0, sizeof die);
    client_signal = 0, note.sa_handler = client_note_signal;
    die.sa_handler = client_die, die.sa_flags = SA_ONSTACK;
    for (int k = 0; k < CLIENT_ORDERLY; k++) {
        sigaction(client_orderly[k], NULL, client_before + k);
        if (k < CLIENT_ALWAYS || client_before[k].sa_handler == SIG_DFL) sigaction(client_orderly[k], &note, NULL);
    }
    for (int k = 0; k < CLIENT_FATAL; k++) sigaction(client_fatal[k], &die, client_before + CLIENT_ORDERLY + k);
}

static void client_give_back(void) {
    for (int k = 0; k < CLIENT_ORDERLY; k++) sigaction(client_orderly[k], client_before + k, NULL);
    for (int k = 0; k < CLIENT_FATAL; k++) sigaction(client_fatal[k], client_before + CLIENT_ORDERLY + k, NULL);
    if (client_signal) raise(client_signal);
}

#endif
