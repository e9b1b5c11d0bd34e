//! [`Model`]: all that the user interface shows.

use std::collections::VecDeque;
use std::time::Duration;

use ratatui::layout::Rect;
use tui_input::Input;

use super::feed::UiEvent;
use super::log::Level;
use super::tool::Tool;
use super::window::{Window, WindowId};
use crate::counts::Row;
use crate::plot::Plot;
use condor_host::control::{ClockStatus, Member, SystemStatus};
use condor_host::plain::plain;
use condor_host::view::{LoopRates, VectorCounts};
use condor_rt::numbers::FILES;

/// Lines of the log that are kept.
const LOG_LINES: usize = 1000;
/// The time that plots show at first.
const PLOTTED: Duration = Duration::from_secs(10);

/// A page of the user interface; on large screens several are seen at once.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(super) enum Page {
    Window(WindowId),
    Loops,
    Messages,
    Files,
    Log,
    Plots,
}

impl Page {
    pub(super) const TABLES: [Self; 4] = [Self::Loops, Self::Messages, Self::Files, Self::Log];
}

/// The popup in front of everything.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Popup {
    Help,
    /// A text is being typed that is searched for in the page in front.
    Search,
    /// The actions on the processor of this place, and the chosen one of them.
    Menu {
        member: usize,
        entry: usize,
    },
    /// The program that the processor of this place is to run is being typed.
    Program {
        member: usize,
    },
    /// The length of a step of the simulated clock is being typed.
    Step,
    /// The processor of this place is about to be given an order that ends its program.
    Confirm {
        member: usize,
        order: &'static str,
    },
    Leave,
}

/// The way in which a person leaves.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Leaving {
    /// The system goes on.
    Running,
    /// The system ends.
    Down,
}

/// The state of the file service beside the counts of its vectors.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct FileServiceState {
    pub(super) messages: u32,
    pub(super) per_second: Option<f64>,
}

#[derive(Debug)]
pub(super) struct Model {
    pub(super) system: String,
    pub(super) uptime: f64,
    /// The simulated clock, if the system has one.
    pub(super) clock: Option<ClockStatus>,
    pub(super) files_root: Option<String>,
    /// The reason why the supervisor does not answer.
    pub(super) gone: Option<String>,
    /// Processors, then services.
    pub(super) members: Vec<Member>,
    pub(super) processors: usize,
    pub(super) windows: Vec<Window>,
    pub(super) loops: Vec<Row<LoopRates>>,
    pub(super) vectors: Vec<Row<VectorCounts>>,
    pub(super) served: FileServiceState,
    /// The reason why there are no counts.
    pub(super) blind: Option<String>,
    pub(super) log: VecDeque<String>,
    /// A line of this program for the log, until the log begins.
    pub(super) own_line: Option<String>,
    /// Lines of the log below this level are not shown.
    pub(super) least: Level,
    pub(super) focus: Page,
    /// The window that was in focus last.
    pub(super) front: Page,
    /// Whether the page in focus is alone on any screen.
    pub(super) zoomed: bool,
    pub(super) popup: Option<Popup>,
    pub(super) notice: Option<String>,
    /// The caption of the present step of a demonstration; empty without one.
    pub(super) caption: String,
    /// The text that is typed into the popup in front.
    pub(super) typed: Input,
    /// The number of lines by which each table is scrolled.
    pub(super) scrolled: [usize; 4],
    pub(super) tools: Vec<Tool>,
    pub(super) plot: Plot,
    /// The screen.
    pub(super) area: Rect,
    ids: u32,
}

impl Model {
    pub(super) fn new(status: &SystemStatus, tools: Vec<Tool>) -> Self {
        let mut model = Self {
            system: status.system.clone(),
            uptime: 0.0,
            clock: None,
            files_root: None,
            gone: None,
            members: Vec::new(),
            processors: 0,
            windows: Vec::new(),
            loops: Vec::new(),
            vectors: Vec::new(),
            served: FileServiceState::default(),
            blind: None,
            log: VecDeque::new(),
            own_line: None,
            least: Level::Information,
            focus: Page::Loops,
            front: Page::Loops,
            zoomed: false,
            popup: None,
            notice: None,
            caption: String::new(),
            typed: Input::default(),
            scrolled: [0; 4],
            tools,
            plot: Plot::new(PLOTTED, None, true),
            area: Rect::new(0, 0, 80, 24),
            ids: 0,
        };
        let mut processors: Vec<&Member> = status.processors.iter().collect();
        processors.sort_by_key(|processor| processor.number);
        for processor in processors {
            let id = model.open_window(processor.name.clone(), processor.number, false);
            if model.ids == 1 {
                model.focus = Page::Window(id);
                model.front = model.focus;
            }
        }
        model.take_status(status);
        model
    }

    /// Opens a window; identities are counted from 1.
    pub(super) fn open_window(&mut self, title: String, processor: u8, is_tool: bool) -> WindowId {
        self.ids += 1;
        let id = WindowId(self.ids);
        self.windows
            .push(Window::new(id, title, processor, is_tool));
        id
    }

    fn take_status(&mut self, status: &SystemStatus) {
        self.gone = None;
        self.uptime = status.uptime;
        self.clock.clone_from(&status.clock);
        self.files_root.clone_from(&status.files_root);
        self.processors = status.processors.len();
        let state = |members: &[Member]| match self.popup {
            Some(Popup::Menu { member, .. } | Popup::Confirm { member, .. }) => {
                members.get(member).map(|member| member.state)
            }
            _ => None,
        };
        let before = state(&self.members);
        self.members = status.members().cloned().collect();
        if state(&self.members) != before {
            // The actions that it shows may be others now.
            self.popup = None;
        }
    }

    /// Takes what came from outside.
    pub(super) fn hear(&mut self, news: UiEvent) {
        match news {
            UiEvent::Status(status) => self.take_status(&status),
            UiEvent::Gone(why) => self.gone = Some(plain(&why).into_owned()),
            UiEvent::LogBegins(lines) => {
                let lines = lines.into_iter().chain(self.own_line.take());
                self.log = lines.map(|line| plain(&line).into_owned()).collect();
            }
            UiEvent::Log(line) => self.log.push_back(plain(&line).into_owned()),
            UiEvent::Opened(id, input) => self.with(id, |window| window.open(input)),
            UiEvent::Output(id, bytes) => self.with(id, |window| window.write(&bytes)),
            UiEvent::Closed(id) => self.closed(id),
            UiEvent::Caption(text) => self.caption = plain(&text).into_owned(),
            UiEvent::Notice(text) => self.notice = Some(plain(&text).into_owned()),
            UiEvent::Plot(news) => self.plot.hear(news),
            UiEvent::Input(_) | UiEvent::NoInput(_) => {}
        }
        while self.log.len() > LOG_LINES {
            self.log.pop_front();
        }
    }

    pub(super) fn with(&mut self, id: WindowId, act: impl FnOnce(&mut Window)) {
        if let Some(window) = self.windows.iter_mut().find(|window| window.id == id) {
            act(window);
        }
    }

    fn closed(&mut self, id: WindowId) {
        self.with(id, Window::close);
        let tool = self.windows.iter().find(|it| it.id == id && it.is_tool);
        if let Some(tool) = tool {
            self.notice = Some(format!("{} has ended; Enter closes its window", tool.title));
        }
    }

    /// Removes the window of a tool that has ended.
    pub(super) fn forget(&mut self, id: WindowId) {
        if self.focus == Page::Window(id) {
            self.step(-1);
        }
        self.windows.retain(|window| window.id != id);
    }

    pub(super) fn window(&self, id: WindowId) -> Option<&Window> {
        self.windows.iter().find(|window| window.id == id)
    }

    pub(super) fn window_mut(&mut self, id: WindowId) -> Option<&mut Window> {
        self.windows.iter_mut().find(|window| window.id == id)
    }

    /// All pages, in the order of the tabs.
    pub(super) fn pages(&self) -> impl Iterator<Item = Page> + Clone {
        let windows = self.windows.iter().map(|window| Page::Window(window.id));
        windows.chain(Page::TABLES).chain([Page::Plots])
    }

    /// Goes so many tabs to the right.
    pub(super) fn step(&mut self, tabs: isize) {
        let pages: Vec<Page> = self.pages().collect();
        let at = pages.iter().position(|page| *page == self.focus);
        let count = isize::try_from(pages.len()).unwrap_or(isize::MAX);
        let to = isize::try_from(at.unwrap_or(0)).unwrap_or(0) + tabs;
        let page = usize::try_from(to.rem_euclid(count)).ok();
        if let Some(page) = page.and_then(|place| pages.get(place)) {
            self.focus = *page;
        }
    }

    /// Has the log show its lines from a level on.
    pub(super) fn show_from(&mut self, least: Level) {
        self.least = least;
        let [.., log] = &mut self.scrolled;
        *log = 0;
    }

    /// Returns the number of lines of a table that are above the visible ones.
    pub(super) fn scroll_of(&self, page: Page) -> usize {
        let place = Page::TABLES.iter().position(|table| *table == page);
        let scrolled = place.and_then(|place| self.scrolled.get(place));
        scrolled.copied().unwrap_or(0)
    }

    /// The place among the members of the processor that is looked at.
    pub(super) fn member_in_focus(&self) -> usize {
        let processor = match self.focus {
            Page::Window(id) => self.window(id).map(|window| window.processor),
            Page::Files => Some(FILES.0),
            _ => None,
        };
        let place = self
            .members
            .iter()
            .position(|member| Some(member.number) == processor);
        place.unwrap_or(0)
    }
}
