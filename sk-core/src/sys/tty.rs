//! Serial ports: opened raw, at a speed, for one process.

use nix::errno::Errno;
use nix::fcntl::{Flock, FlockArg, OFlag};
use nix::sys::termios::{
    BaudRate, ControlFlags, FlushArg, SetArg, Termios, cfmakeraw, cfsetspeed, tcflush, tcgetattr, tcsetattr,
};
use std::fs::{File, OpenOptions};
use std::io;
use std::os::unix::fs::OpenOptionsExt;
use std::path::Path;

/// The speeds that Linux knows by name, in bits a second.
const SPEEDS: [(u32, BaudRate); 18] = [
    (9600, BaudRate::B9600),
    (19_200, BaudRate::B19200),
    (38_400, BaudRate::B38400),
    (57_600, BaudRate::B57600),
    (115_200, BaudRate::B115200),
    (230_400, BaudRate::B230400),
    (460_800, BaudRate::B460800),
    (500_000, BaudRate::B500000),
    (576_000, BaudRate::B576000),
    (921_600, BaudRate::B921600),
    (1_000_000, BaudRate::B1000000),
    (1_152_000, BaudRate::B1152000),
    (1_500_000, BaudRate::B1500000),
    (2_000_000, BaudRate::B2000000),
    (2_500_000, BaudRate::B2500000),
    (3_000_000, BaudRate::B3000000),
    (3_500_000, BaudRate::B3500000),
    (4_000_000, BaudRate::B4000000),
];

/// Opens a serial port without waiting: eight bits, no parity, one stop bit, no flow control, nothing translated.
/// What came before is dropped.
///
/// # Errors
/// `InvalidInput` for a speed that there is not, `ResourceBusy` while another process has the port, ENOTTY for what
/// is no port.
pub(crate) fn open_raw(path: &Path, baud: u32) -> io::Result<Flock<File>> {
    let Some((_, speed)) = SPEEDS.iter().find(|(known, _)| *known == baud) else {
        let known: Vec<String> = SPEEDS.iter().map(|(known, _)| known.to_string()).collect();
        let what = format!("{baud} is no speed of a serial port; there are {}", known.join(", "));
        return Err(io::Error::new(io::ErrorKind::InvalidInput, what));
    };
    let flags = OFlag::O_NOCTTY | OFlag::O_NONBLOCK;
    let file = OpenOptions::new()
        .read(true)
        .write(true)
        .custom_flags(flags.bits())
        .open(path)?;
    // Two who read the same port would each get a part of what comes.
    let file = Flock::lock(file, FlockArg::LockExclusiveNonblock).map_err(|(_, error)| match error {
        Errno::EWOULDBLOCK => io::Error::new(io::ErrorKind::ResourceBusy, "another program has the port"),
        other => io::Error::from(other),
    })?;
    let mut settings: Termios = tcgetattr(&*file)?;
    cfmakeraw(&mut settings);
    settings.control_flags |= ControlFlags::CLOCAL | ControlFlags::CREAD;
    settings.control_flags &= !(ControlFlags::CRTSCTS | ControlFlags::CSTOPB);
    cfsetspeed(&mut settings, *speed)?;
    tcsetattr(&*file, SetArg::TCSANOW, &settings)?;
    tcflush(&*file, FlushArg::TCIOFLUSH)?;
    Ok(file)
}
