// Tells a service manager how this process is doing, by the protocol of sd_notify(3): datagrams to
// the socket that the environment variable NOTIFY_SOCKET names.
#ifndef PM_APP_NOTIFY_H
#define PM_APP_NOTIFY_H

// Sends assignments such as "READY=1" or "STATUS=...\nWATCHDOG=1", formatted as by printf. Does
// nothing where no manager listens; a message that cannot be sent is lost.
__attribute__((format(printf, 1, 2))) void pm_notify(const char *format, ...);

#endif
