//! Additions to `--help`: examples and the names that an argument takes; completions and the
//! manual.

use crate::output::print_bytes;
use clap::{Args, Command};
use clap_complete::Shell;
use headbox_house::backdrop::BackdropKind;
use headbox_house::variant::HouseVariant;
use std::ffi::OsString;

/// Examples of each subcommand.
const EXAMPLES: [(&str, &str); 18] = [
    ("demo", "headbox demo --quick --no-window"),
    ("scenes", "headbox scenes"),
    (
        "capture",
        "headbox capture room.obj -o room.ldi --quality draft     check the placement of the headbox\n  \
         headbox capture room.obj -o room.ldi                     capture it at full quality\n  \
         headbox capture builtin:interior -o a.ldi --center 0,1.6,0 --half-size 0.4\n  \
         headbox capture room.obj -o 1.shard --shard 1/2          first of two parts; see headbox merge",
    ),
    ("merge", "headbox merge 1.shard 2.shard -o room.ldi"),
    (
        "sprite",
        "headbox sprite builtin:sprites -o layers.sprite --size 512x384\n  \
         headbox sprite photographs -o layers.sprite --view frame-000175.color --layers 6\n  \
         headbox sprite --color photo.png --depth depth.exr --depth-kind eye -o photo.sprite",
    ),
    (
        "lumigraph",
        "headbox lumigraph room.obj -o room.lumi\n  \
         headbox lumigraph stage.glb -o stage.lumi --plane 0,1.6,5 --normal 0,0,-1 --extent 2 --cameras 8x8 --layers 64\n  \
         headbox lumigraph statue.glb -o statue.lumi --plane 0,1,3 --normal 0,0,-1 --extent 2 --slabs 8 --about 0,1,0\n  \
         headbox lumigraph wall-of-photographs -o wall.lumi",
    ),
    (
        "house",
        "headbox house Home.xml --plan home.svg                   list its rooms and errors, draw its plan\n  \
         headbox house Home.xml -o home.house --walk walk.json    bake its light, capture backdrops of its doors",
    ),
    (
        "images",
        "headbox images scans/kitchen                             describe it, check that poses and depths agree\n  \
         headbox images photos --align                            estimate poses of photographs with COLMAP\n  \
         headbox images photos --depth                            estimate their depth, stored in the same folder\n  \
         headbox images scans/kitchen --depth -o new              as a new set, compared with its known depth",
    ),
    (
        "info",
        "headbox info room.ldi --check\n  \
         headbox info room.obj                                    its extent, its lights, where a capture would stand",
    ),
    (
        "render",
        "headbox render room.ldi -o frame.png\n  \
         headbox render room.ldi -o frame.jpg --eye 0.1,1.6,0 --look-at 2,1,0 --size 1920x1080\n  \
         headbox render scans/kitchen -o frame.png --variant geometry-averaged     folder of images with depth, without a capture\n  \
         headbox render home.house --path walk.json -o frames     one frame per pose, and frame times\n  \
         headbox render room.ldi -o room.mp4                      a film: the eye moves about in the headbox\n  \
         headbox render room.ldi --path walk.json -o walk.mp4 --panorama    along a path, equirectangular\n  \
         headbox render room.ldi -o - | display                   pipe a PNG to another program",
    ),
    (
        "export",
        "headbox export room.ldi -o room.html                     offline page to look around in, for any browser\n  \
         headbox export home.house -o home.html                   offline page to walk through\n  \
         headbox export room.ldi -o room.glb --triangles 100000   for Unity, Unreal, Godot, three.js, Blender\n  \
         headbox export room.ldi -o room.ply                      for viewers and editors of Gaussian splats",
    ),
    (
        "walk",
        "headbox walk home.house -o walk-report --poses 20 --variants texture,window-ldi",
    ),
    (
        "truth",
        "headbox truth room.ldi -o truth.png --time 60            in the light and from the camera of a capture\n  \
         headbox truth room.ldi -o truth.png --noise 40           until its noise is hardly visible\n  \
         headbox truth room.obj -o truth.png --samples 64",
    ),
    (
        "compare",
        "headbox compare truth.png frame.png --map error.png",
    ),
    (
        "report",
        "headbox report room.obj@up=z@half=0.4 -o report --quick",
    ),
    (
        "view",
        "headbox view                                             the start page\n  \
         headbox view room.ldi chair.glb@at=1,0,-2                a model in a captured room\n  \
         headbox view room.obj                                    capture while looking around\n  \
         headbox view room.ldi --screenshot window.png            image of the window, for scripts",
    ),
    ("man", "headbox man | man -l -"),
    (
        "completions",
        "headbox completions bash > ~/.local/share/bash-completion/completions/headbox",
    ),
];

/// Help of the scene of `truth`, which unlike that of `capture` may be a capture.
const TRUTH_SCENE: &str = "Scene: an .obj, .gltf, .glb, .ply or .stl file, a home (Home.xml, .sh3d, .toml), or \
    builtin:NAME; or an .ldi file, whose scene is traced in the light, with the exposure and from the camera of the file";

/// Adds examples, the defaults that `--quality` sets and the scene of `truth` to the command line.
pub(super) fn with_examples(cli: Command) -> Command {
    let names: Vec<String> = cli
        .get_subcommands()
        .map(|command| command.get_name().to_owned())
        .collect();
    let known = |name: &str| names.iter().any(|known| known == name);
    let cli = cli.mut_subcommand("capture", |capture| {
        crate::commands::capture::Preset::NUMBERS.iter().fold(
            capture,
            |capture, (argument, [draft, good])| {
                let presets = [
                    ("quality", "draft", Some(*draft)),
                    ("quality", "good", Some(*good)),
                ];
                capture.mut_arg(*argument, |argument| argument.default_value_ifs(presets))
            },
        )
    });
    let cli = cli.mut_subcommand("truth", |truth| {
        truth.mut_arg("scene", |scene| scene.help(TRUTH_SCENE))
    });
    EXAMPLES
        .iter()
        .filter(|(name, _)| known(name))
        .fold(cli, |cli, (name, examples)| {
            cli.mut_subcommand(*name, |command| {
                // An argument that begins with a dash and a digit is a number, not a flag.
                command
                    .after_help(format!("Examples:\n  {examples}{}", names_for(name)))
                    .allow_negative_numbers(true)
            })
        })
}

/// Names that arguments of a subcommand accept, as text after the examples.
fn names_for(command: &str) -> String {
    match command {
        "walk" => format!("\n\nVariants:\n  {}", HouseVariant::names()),
        "house" => {
            let kinds = BackdropKind::ALL.map(BackdropKind::name);
            format!("\n\nBackdrops:\n  {}, none", kinds.join(", "))
        }
        _ => String::new(),
    }
}

/// Collects the arguments of this process; `help --help` means `help`.
pub(super) fn arguments(all: impl IntoIterator<Item = OsString>) -> Vec<OsString> {
    let all: Vec<_> = all.into_iter().collect();
    let is_help = all.get(1).is_some_and(|first| first == "help");
    all.into_iter()
        .filter(|word| !is_help || (word != "--help" && word != "-h"))
        .collect()
}

/// `headbox completions`.
#[derive(Args)]
pub(super) struct Completions {
    /// Shell to complete commands in
    shell: Shell,
}

impl Completions {
    pub(super) fn run(&self, mut whole: Command) -> anyhow::Result<()> {
        let mut script = Vec::new();
        clap_complete::generate(self.shell, &mut whole, "headbox", &mut script);
        print_bytes(&script);
        Ok(())
    }
}

/// Prints the manual pages of the program and of each of its commands: `headbox man`.
pub(super) fn print_manual(whole: &Command) -> anyhow::Result<()> {
    let mut page = Vec::new();
    clap_mangen::Man::new(whole.clone()).render(&mut page)?;
    for sub in whole
        .get_subcommands()
        .filter(|sub| sub.get_name() != "help")
    {
        let name = format!("headbox-{}", sub.get_name());
        clap_mangen::Man::new(sub.clone().display_name(name)).render(&mut page)?;
    }
    print_bytes(&page);
    Ok(())
}
