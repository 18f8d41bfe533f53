//! `headbox serve`: pages over HTTP, read-only.
//!
//! A server of the standard library alone: what it gives is a table that is made before the first request, so that no word of a
//! request ever names a file, and two methods and one header are all that it has to know.

use super::export::name_of;
use crate::commands::export::input::Exported;
use crate::output::Outputs;
use crate::words::UsageError;
use anyhow::Context;
use clap::Args;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Write};
use std::net::{IpAddr, Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::path::PathBuf;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Duration;

/// Longest head of a request, bytes.
const MAX_HEAD: u64 = 16 << 10;
/// How long a reader may say or take nothing.
const PATIENCE: Duration = Duration::from_secs(20);
/// Connections at a time; more are turned away.
const MAX_CONNECTIONS: usize = 64;

#[derive(Args)]
pub(crate) struct ServeCommand {
    /// .ldi, .sprite, .house and .lumi files
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
    /// Address to listen on; this machine alone (127.0.0.1) if absent
    #[arg(long, value_name = "ADDR", default_value_t = IpAddr::V4(Ipv4Addr::LOCALHOST))]
    bind: IpAddr,
    /// Port to listen on; 0 takes a free one
    #[arg(long, default_value_t = 8080)]
    port: u16,
}

/// What can be asked for.
struct Resource {
    path: String,
    kind: &'static str,
    content: Content,
}

enum Content {
    Bytes(Vec<u8>),
    File(File),
}

impl ServeCommand {
    pub(crate) fn run(&self) -> anyhow::Result<()> {
        let _ = Outputs::new(false, &self.files);
        let resources = self.resources()?;
        let address = SocketAddr::new(self.bind, self.port);
        let listener = TcpListener::bind(address)
            .with_context(|| format!("{address} cannot be listened on; try another --port"))?;
        println!("http://{}/ shows {} (Ctrl-C ends it)", listener.local_addr()?, words(self.files.len()));
        let (resources, open) = (&resources, &AtomicUsize::new(0));
        let loopback = self.bind.is_loopback();
        std::thread::scope(|scope| {
            for stream in listener.incoming().flatten() {
                if open.fetch_add(1, Ordering::Relaxed) >= MAX_CONNECTIONS {
                    open.fetch_sub(1, Ordering::Relaxed);
                    continue;
                }
                scope.spawn(move || {
                    // A reader that has gone is nobody's trouble.
                    let _ = answer(&stream, resources, loopback);
                    open.fetch_sub(1, Ordering::Relaxed);
                });
            }
        });
        Ok(())
    }

    /// The list, and for each file its page, its picture and itself.
    fn resources(&self) -> anyhow::Result<Vec<Resource>> {
        let mut resources = Vec::new();
        let mut rows = String::new();
        for (i, file) in self.files.iter().enumerate() {
            let name = name_of(file);
            let exported = Exported::open(file)?;
            let page = exported.page(&name).with_context(|| file.display().to_string())?;
            let mut spooled = tempfile::tempfile()?;
            page.write(&mut io::BufWriter::new(&mut spooled))?;
            let title = headbox_export::page::escape(&name);
            let (amount, of_what) = exported.amount();
            let ending = exported.ending();
            rows += &format!(
                "<li><a href=\"/{i}/page.html\"><img src=\"/{i}/poster.jpg\" alt=\"\" width=\"400\" height=\"250\">{title}</a> \
                 <small>{amount} {of_what}, <a href=\"/{i}/capture.{ending}\" download=\"{title}.{ending}\">.{ending}</a></small></li>\n"
            );
            let add = [
                ("page.html".into(), "text/html; charset=utf-8", Content::File(spooled)),
                ("poster.jpg".into(), "image/jpeg", Content::Bytes(exported.poster()?)),
                (format!("capture.{ending}"), "application/octet-stream", Content::File(File::open(file)?)),
            ];
            let of_file = add.into_iter();
            resources.extend(of_file.map(|(name, kind, content)| Resource {
                path: format!("/{i}/{name}"),
                kind,
                content,
            }));
        }
        let list = LIST.replace("@ROWS@", &rows);
        let content = Content::Bytes(list.into_bytes());
        resources.push(Resource { path: "/".into(), kind: "text/html; charset=utf-8", content });
        if self.port == 0 && self.bind.is_unspecified() {
            return Err(UsageError("give a --port where others are to find it".into()).into());
        }
        Ok(resources)
    }
}

const LIST: &str = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>headbox</title>\n\
    <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
    <style>body { font: 16px system-ui, sans-serif; background: #14161a; color: #e8e8e8; margin: 2rem } a { color: #9cf }\n\
    ul { list-style: none; padding: 0; display: flex; flex-wrap: wrap; gap: 1.5rem } li { width: 400px }\n\
    img { display: block; border-radius: 6px; max-width: 100% }</style></head>\n\
    <body><h1>Captures</h1><ul>\n@ROWS@</ul></body></html>\n";

fn words(files: usize) -> String {
    if files == 1 { "one capture".into() } else { format!("{files} captures") }
}

impl Content {
    fn length(&self) -> io::Result<u64> {
        match self {
            Self::Bytes(bytes) => Ok(bytes.len() as u64),
            Self::File(file) => Ok(file.metadata()?.len()),
        }
    }

    /// Sends the bytes from `start` on.
    fn send(&self, start: u64, length: u64, to: &mut impl Write) -> io::Result<()> {
        match self {
            Self::Bytes(bytes) => to.write_all(&bytes[start as usize..(start + length) as usize]),
            Self::File(file) => {
                let mut part = Positioned { file, at: start }.take(length);
                io::copy(&mut part, to).map(drop)
            }
        }
    }
}

/// A file read from a place of one's own, while others read it, too.
struct Positioned<'a> {
    file: &'a File,
    at: u64,
}

impl Read for Positioned<'_> {
    #[cfg(unix)]
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let count = std::os::unix::fs::FileExt::read_at(self.file, to, self.at)?;
        self.at += count as u64;
        Ok(count)
    }

    #[cfg(not(unix))]
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        let count = std::os::windows::fs::FileExt::seek_read(self.file, to, self.at)?;
        self.at += count as u64;
        Ok(count)
    }
}

/// Reads one request and answers it.
fn answer(stream: &TcpStream, resources: &[Resource], loopback: bool) -> io::Result<()> {
    stream.set_read_timeout(Some(PATIENCE))?;
    stream.set_write_timeout(Some(PATIENCE))?;
    let mut head = String::new();
    let mut reader = BufReader::new(stream.take(MAX_HEAD));
    while !head.ends_with("\r\n\r\n") && !head.ends_with("\n\n") {
        if reader.read_line(&mut head)? == 0 {
            break;
        }
    }
    respond(&head, resources, loopback, &mut io::BufWriter::new(stream))
}

/// A part of a resource: first byte and length.
#[derive(Debug, PartialEq)]
enum Part {
    Whole,
    Range(u64, u64),
    Unsatisfiable,
}

/// What a `Range` header asks of `length` bytes; several ranges, and what is no range, ask for the whole.
fn part(header: Option<&str>, length: u64) -> Part {
    let Some((first, last)) = header.and_then(|text| text.trim().strip_prefix("bytes=")?.split_once('-')) else {
        return Part::Whole;
    };
    let (start, end) = match (first.trim().parse::<u64>(), last.trim().parse::<u64>()) {
        (Ok(start), Ok(last)) if start <= last => (start, last.saturating_add(1).min(length)),
        (Ok(start), Err(_)) if last.trim().is_empty() => (start, length),
        (Err(_), Ok(count)) if first.trim().is_empty() => (length.saturating_sub(count), length),
        _ => return Part::Whole,
    };
    if start < end { Part::Range(start, end - start) } else { Part::Unsatisfiable }
}

fn respond(head: &str, resources: &[Resource], loopback: bool, to: &mut impl Write) -> io::Result<()> {
    let mut words = head.lines().next().unwrap_or_default().split(' ');
    let (method, path) = (words.next().unwrap_or_default(), words.next().unwrap_or_default());
    let header = |name: &str| {
        let lines = head.lines().skip(1).filter_map(|line| line.split_once(':'));
        lines.filter(|(key, _)| key.eq_ignore_ascii_case(name)).map(|(_, value)| value.trim()).next()
    };
    if !words.next().is_some_and(|version| version.starts_with("HTTP/1.")) {
        return refuse(to, "400 Bad Request", "");
    }
    // A name that leads here although it is not this machine's belongs to a page that wants to read what is only ours.
    if loopback && !header("host").is_none_or(is_local) {
        return refuse(to, "403 Forbidden", "");
    }
    if method != "GET" && method != "HEAD" {
        return refuse(to, "405 Method Not Allowed", "Allow: GET, HEAD\r\n");
    }
    let path = path.split(['?', '#']).next().unwrap_or_default();
    let Some(resource) = resources.iter().find(|resource| resource.path == path) else {
        return refuse(to, "404 Not Found", "");
    };
    let length = resource.content.length()?;
    let (status, start, count, range) = match part(header("range"), length) {
        Part::Whole => ("200 OK", 0, length, String::new()),
        Part::Range(start, count) => {
            let range = format!("Content-Range: bytes {start}-{}/{length}\r\n", start + count - 1);
            ("206 Partial Content", start, count, range)
        }
        Part::Unsatisfiable => {
            return refuse(to, "416 Range Not Satisfiable", &format!("Content-Range: bytes */{length}\r\n"));
        }
    };
    write!(
        to,
        "HTTP/1.1 {status}\r\nContent-Type: {}\r\nContent-Length: {count}\r\nAccept-Ranges: bytes\r\n{range}\
         X-Content-Type-Options: nosniff\r\nConnection: close\r\n\r\n",
        resource.kind
    )?;
    if method == "GET" {
        resource.content.send(start, count, to)?;
    }
    to.flush()
}

/// Whether a `Host` header names this machine.
fn is_local(host: &str) -> bool {
    let name = match host.strip_prefix('[') {
        Some(rest) => rest.split(']').next().unwrap_or_default(),
        None => host.split(':').next().unwrap_or_default(),
    };
    name.eq_ignore_ascii_case("localhost") || name.parse::<IpAddr>().is_ok_and(|address| address.is_loopback())
}

fn refuse(to: &mut impl Write, status: &str, more: &str) -> io::Result<()> {
    write!(
        to,
        "HTTP/1.1 {status}\r\n{more}Content-Type: text/plain\r\nContent-Length: {}\r\nConnection: close\r\n\r\n{status}\n",
        status.len() + 1
    )?;
    to.flush()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ask(request: &str) -> String {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(b"0123456789").unwrap();
        // Where the file was left does not matter.
        let resources = [
            Resource { path: "/".into(), kind: "text/html", content: Content::Bytes(b"list".to_vec()) },
            Resource { path: "/0/capture.ldi".into(), kind: "application/octet-stream", content: Content::File(file) },
        ];
        let mut answer = Vec::new();
        respond(request, &resources, true, &mut answer).unwrap();
        String::from_utf8(answer).unwrap()
    }

    #[test]
    fn what_is_in_the_table_is_given_whole_or_in_part() {
        assert!(ask("GET / HTTP/1.1\r\nHost: localhost:8080\r\n\r\n").ends_with("\r\n\r\nlist"));
        assert!(ask("HEAD / HTTP/1.1\r\n\r\n").ends_with("close\r\n\r\n"));
        let ranges = [
            ("bytes=2-4", "234"),
            ("bytes=7-", "789"),
            ("bytes=-2", "89"),
            ("bytes=8-99", "89"),
            ("bytes=-99", "0123456789"),
        ];
        for (range, expected) in ranges {
            let answer = ask(&format!("GET /0/capture.ldi?v=1 HTTP/1.1\r\nrange: {range}\r\n\r\n"));
            assert!(answer.starts_with("HTTP/1.1 206") && answer.ends_with(&format!("\r\n\r\n{expected}")), "{answer}");
        }
        assert!(ask("GET /0/capture.ldi HTTP/1.1\r\nRange: bytes=0-1,4-5\r\n\r\n").starts_with("HTTP/1.1 200"));
        assert!(ask("GET /0/capture.ldi HTTP/1.1\r\nRange: bytes=10-\r\n\r\n").starts_with("HTTP/1.1 416"));
        assert_eq!(part(Some("bytes=5-2"), 9), Part::Whole);
    }

    #[test]
    fn nothing_else_is() {
        for path in
            ["/../Cargo.toml", "//etc/passwd", "/0/", "/0/../0/capture.ldi", "/%2e%2e/x", "file:///etc/passwd", ""]
        {
            assert!(ask(&format!("GET {path} HTTP/1.1\r\n\r\n")).starts_with("HTTP/1.1 40"), "{path}");
        }
        assert!(ask("PUT / HTTP/1.1\r\n\r\n").starts_with("HTTP/1.1 405"));
        assert!(ask("GET / HTTP/1.1\r\nHost: evil.example\r\n\r\n").starts_with("HTTP/1.1 403"));
        assert!(ask("nonsense").starts_with("HTTP/1.1 400") && ask("").starts_with("HTTP/1.1 400"));
    }
}
