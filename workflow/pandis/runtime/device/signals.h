/* Signals that stop, end or crash the process of a run: zero force is sent before they take effect.
 * Part of client.c. */
#ifndef SIGNALS_H
#define SIGNALS_H

/* Signals that end or stop a program. Those in the first row are always intercepted, those in the
 * second unless the program handles them. The run ends with zero force, and then the signal is
 * raised again for the program's handler. */
static const int client_orderly[] = {SIGINT, SIGTERM, SIGHUP, SIGQUIT, SIGTSTP, /* always */
    SIGUSR1, SIGUSR2, SIGALRM, SIGXCPU, SIGTTIN, SIGTTOU, SIGVTALRM, SIGPROF};
/* Signals after which nothing can be relied on: their handler sends zero force. */
static const int client_fatal[] = {SIGSEGV, SIGBUS, SIGFPE, SIGILL, SIGABRT};
enum {
    CLIENT_ALWAYS = 5,
    CLIENT_ORDERLY = sizeof client_orderly / sizeof *client_orderly,
    CLIENT_FATAL = sizeof client_fatal / sizeof *client_fatal
};
static struct sigaction client_before[CLIENT_ORDERLY + CLIENT_FATAL];

/* Switch the motors off, and raise the signal again with its former action. */
static void client_die(int number) {
    const double zero[3] = {0};
    device *d = &client.device;
    /* end this thread's own frame with zero; a frame of another thread must not be touched */
    if (__atomic_load_n(&client.inside, __ATOMIC_SEQ_CST) &&
        pthread_equal(client_ticking, pthread_self()))
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
        if (k < CLIENT_ALWAYS || client_before[k].sa_handler == SIG_DFL)
            sigaction(client_orderly[k], &note, NULL);
    }
    for (int k = 0; k < CLIENT_FATAL; k++)
        sigaction(client_fatal[k], &die, client_before + CLIENT_ORDERLY + k);
}

static void client_give_back(void) {
    for (int k = 0; k < CLIENT_ORDERLY; k++) sigaction(client_orderly[k], client_before + k, NULL);
    for (int k = 0; k < CLIENT_FATAL; k++)
        sigaction(client_fatal[k], client_before + CLIENT_ORDERLY + k, NULL);
    if (client_signal) raise(client_signal);
}

#endif
